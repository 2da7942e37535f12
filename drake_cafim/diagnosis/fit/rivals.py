"""The laws that compete with each effect of a fit at its place, kept for where nothing has changed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.beside import strengths_at
from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import ELSEWHERE, joint_of
from drake_cafim.diagnosis.thresholds import RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.effects.joint import DRY_FRICTION, JointCoulombFriction

Lead = tuple[float, Fit, Effect]
"""By how much an explanation's criterion exceeds the best one's, in units of what blocks show; itself; its own law."""

FITTED_LEAD = 6.0
"""Criterion beyond the best one's, to first order, up to which a law is fitted exactly: its probability is then 5 %."""
REPLACING_LEAD = 2.0
"""By how much the criterion of another law must be lower, to first order, for it to be tried in an effect's place: what
is less is "not worth more than a bare mention" (Kass, Raftery, J. Am. Stat. Assoc. 90, 1995), and would be tried back
and forth."""


@dataclass(frozen=True)
class Rivals:
    """The contenders that were found for each effect of a fit, by its key.

    What acts at one joint does not show in the equations of another, so that they stand wherever nothing has changed at
    an effect's joint.
    """

    beside: Fit
    """The fit, without its slopes."""
    found: Mapping[Key, Sequence[Lead]]

    @classmethod
    def of(cls, best: Fit, found: Mapping[Key, Sequence[Lead]]) -> "Rivals":
        """Those `found` beside a fit."""
        return cls(replace(best, jacobian=best.jacobian[:0]), found)

    def at(self, best: Fit, whitened: bool) -> dict[Key, list[Lead]]:
        """Those of the effects of another fit `best` at whose joints nothing has changed, beside that fit.

        Where the rows were `whitened` anew, nothing has if no strength there moved by more than its standard deviation,
        and only laws stand that were no rivals: of others the evidence is another.
        """
        changed = {joint_of(effect) for effect in changed_effects(self.beside, best, moved=whitened)}
        kept: dict[Key, list[Lead]] = {}
        for effect in best.model.effects:
            leads, here = self.found.get(effect.key), joint_of(effect)
            if leads is None or changed & {here, ELSEWHERE}:
                continue
            if changed and (here == ELSEWHERE or is_alike_elsewhere(effect)):
                continue
            if whitened and any(map(self._is_rival, leads)):
                continue
            rest, risen = best.model.without(effect), best.chi_square - self.beside.chi_square
            kept[effect.key] = [
                (lead, replace(other, model=rest.with_effects([law]), penalty=other.penalty + risen), law)
                for lead, other, law in leads
            ]
        return kept

    def _is_rival(self, contender: Lead) -> bool:
        """Whether a law comes near in its probability, or in its χ² as a report's rivals do."""
        lead, other, _ = contender
        near = RIVAL_EXCESS_CHI_SQUARE * scale_of(self.beside)
        return lead <= FITTED_LEAD or other.chi_square - self.beside.chi_square < near


def is_alike_elsewhere(effect: Effect) -> bool:
    """Whether the same effect at another joint may explain what this one does: it is listed among those alike."""
    return effect.name in effect.alike


def prior_odds(model: Model, effect: Effect, law: Effect) -> float:
    """The odds of a `law` against an `effect` at its place before its evidence, by what `model` has at other places.

    What one joint of a machine lacks, others are likely to lack: where n places have the law and m the effect they are
    (n + ½)/(m + ½), as of kinds whose shares have Jeffreys' prior (Jeffreys, Proc. R. Soc. A 186, 1946).
    """
    elsewhere = [_kind(other) for other in model.effects if joint_of(other) != joint_of(effect)]
    return (elsewhere.count(_kind(law)) + 0.5) / (elsewhere.count(_kind(effect)) + 0.5)


def _kind(effect: Effect) -> tuple[str, str]:
    """Its name and, for a channel, which reading."""
    return effect.name, effect.at.partition(".")[0] if effect.place is Place.CHANNEL else ""


def changed_effects(before: Fit, after: Fit, moved: bool) -> list[Effect]:
    """The effects that only one of two fits has and, with `moved`, those that moved by a standard deviation or more."""
    sides = (before.model, after.model)
    changed = [it for model in sides for it in model.effects if it.key not in sides[0].keys & sides[1].keys]
    had = {effect.key: (position, effect) for position, effect in enumerate(before.model.effects)}
    for effect in after.model.effects if moved else ():
        if effect.key in had:
            position, known = had[effect.key]
            std = np.sqrt(np.diag(before.covariance))[strengths_at(before.model, position)]
            changed += [effect] if np.any(np.abs(effect.vector - known.vector) > std) else []
    return changed


def act_alike(a: Effect, b: Effect) -> bool:
    """Whether one of two effects lists the other, or the simplest law of dry friction for any, among those alike."""
    names = [{effect.name} | ({JointCoulombFriction.name} if is_dry(effect) else set()) for effect in (a, b)]
    return bool(names[0] & b.alike.keys() or names[1] & a.alike.keys())


def is_nonlinear_rival(effect: Effect, law: Effect) -> bool:
    """Whether two laws are listed as alike, and one of them is far from linear in its strengths.

    Laws of dry friction are none: the simplest stands for all of them.
    """
    return not is_dry(law) and act_alike(effect, law) and not (effect.all_but_linear and law.all_but_linear)


def is_dry(effect: Effect) -> bool:
    """Whether an effect is dry friction of any law."""
    return effect.group == DRY_FRICTION


def noise_changed(effect: Effect) -> str:
    """How an effect changes the noise of motion in the equations: as a stiff law, an inertia or a filter; else ""."""
    if is_dry(effect):
        return "stiffness"
    if effect.changes_inertia:
        return "inertia"
    return "filter" if effect.late else ""
