"""Chooses the friction of each joint: of nested laws the simplest one that the recordings support.

The laws of dry friction are one phenomenon in more or less detail, and each may act beside viscous friction. One by one
they share their evidence, and what a detail gains near rest says nothing against the law away from it. So they are
fitted at each joint together with viscous friction and without, and a law stands only where the recordings show each of
its parts, and that it is none of the simpler laws that it contains.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.beside import Beside, strengths_at
from drake_cafim.diagnosis.fit.evidence import criterion, leaves_noise
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.posterior import posterior
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std
from drake_cafim.diagnosis.fit.screening import Candidate, screen
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.determined import strength_at_bound, undetermined_in
from drake_cafim.diagnosis.search.growth_by_place import FIRST_ORDER_SHORTFALL, GrowthByPlace
from drake_cafim.diagnosis.search.law_shapes import fit_shape_beside
from drake_cafim.diagnosis.trace import Record, spoken
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import DRY_FRICTION, JointViscousFriction
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Friction:
    """The `laws` of friction at a joint, one of them dry, `found` with all else refitted to first order."""

    found: Fit
    laws: tuple[Effect, ...]

    @property
    def dry(self) -> Effect:
        """Its law of dry friction."""
        return next(law for law in self.laws if law.group == DRY_FRICTION)


def is_friction(effect: Effect) -> bool:
    """Whether an effect is friction of a joint, viscous or dry."""
    return effect.group == DRY_FRICTION or effect.name == JointViscousFriction.name


def choose_friction(growth: GrowthByPlace) -> dict[str, list[Friction]]:
    """Gives each joint of `growth.best` with dry friction the simplest laws that stand there and explain as much.

    All that stand are returned, by joint, the chosen ones first. Where none stands, nothing is changed.
    """
    joints = [effect.at for effect in growth.best.model.effects if effect.group == DRY_FRICTION]
    standing: dict[str, list[Friction]] = {}
    for joint in joints:
        own, options = [], list(_options(growth, joint))
        for option in options:
            failure = failure_of(growth, option, options)
            if failure is None:
                own.append(option)
            else:
                growth.trace.add(failure)
        if own:
            standing[joint] = _by_preference(growth, own)
            growth.trace.add(*_record_choice(growth, standing[joint]))
    model = growth.best.model
    for joint, [chosen, *_] in standing.items():
        rest = [effect for effect in model.effects if not (is_friction(effect) and effect.at == joint)]
        model = Model(model.unknown, (*rest, *chosen.laws), model.free)
    if model.keys != growth.best.model.keys:
        growth.take(model)
        growth.converge()
    return standing


def failure_of(growth: GrowthByPlace, option: Friction, options: Sequence[Friction] = ()) -> Record | None:
    """The record of the first test that a law of `option`, one of the `options`, fails; None where it stands.

    The recordings have to determine each of its laws, and to show that it acts and is none of the simpler laws that it
    contains: by its strengths or, where they are far from linear, by the fits of these (`_exceeds`).
    """
    found = option.found
    std = np.maximum(found.std, blockwise_std(growth.problem, found))
    for law in option.laws:
        bound, wide = strength_at_bound(law), undetermined_in(found, law, std)
        if bound is not None:
            return decisions.record_bound(found.model, law, bound)
        if wide is not None:
            return decisions.record_undetermined(found.model, law, *wide)
        if not growth.nominal.plausible(Model(found.model.unknown, (law,))):
            return decisions.record_implausible(found.model, law)
        contrasts = [("no effect", *law.vanishing())]
        names = {spoken(simpler): simpler for simpler in law.narrows}
        for simpler, weights in law.narrows.items():
            contrasts.append((spoken(simpler), np.array([law.vector @ weights]), np.array([weights])))
        for simpler, difference, slope in contrasts:
            shown = growth.shown(growth.problem, found, law.key, difference, slope)
            threshold = growth.threshold(len(difference))
            if shown < threshold and not (simpler in names and _exceeds(growth, option, names[simpler], options)):
                return decisions.record_contrast(found.model, law, simpler, shown, threshold)
    return None


def _exceeds(growth: GrowthByPlace, option: Friction, simpler: str, options: Sequence[Friction]) -> bool:
    """Whether χ² is lower than with all `simpler` laws of dry friction by more than noise makes of the strengths more.

    The likelihood ratio holds where strengths are far from linear, as the velocity over which friction falls is: its
    std then says too little of how sure the fall is. It asks that noise alone be left: a correlated residual has no
    likelihood.
    """
    if not leaves_noise(growth.problem, option.found, growth.settings.adequacy_level):
        return False
    others = [other for other in options if other.dry.name == simpler and _luck(growth, option, other) > 0.0]
    return bool(others) and all(_gain(option, other) >= _luck(growth, option, other) for other in others)


def _by_preference(growth: GrowthByPlace, options: Sequence[Friction]) -> list[Friction]:
    """The `options` by their criterion, the simplest first of those that explain as much as the best one.

    Each further strength has to lower χ² by more than noise makes of it: near rest, laws also differ by how the
    velocity's noise is reckoned with.
    """
    best, *others = sorted(options, key=lambda option: criterion(option.found, 1.0, growth.trials))
    alike = [best, *(other for other in others if _gain(best, other) < _luck(growth, best, other))]
    chosen = min(alike, key=lambda option: option.found.strengths)
    return [chosen, *(option for option in (best, *others) if option is not chosen)]


def _gain(larger: Friction, simpler: Friction) -> float:
    """By how much χ² is lower with the larger laws."""
    return simpler.found.chi_square - larger.found.chi_square


def _luck(growth: GrowthByPlace, larger: Friction, simpler: Friction) -> float:
    """What noise alone makes of the strengths that larger laws have more; minus infinity where they have no more."""
    more = larger.found.strengths - simpler.found.strengths
    return growth.threshold(more) if more > 0 else -np.inf


def _record_choice(growth: GrowthByPlace, standing: Sequence[Friction]) -> Iterator[Record]:
    """Why of the laws of friction that stand at a joint the first ones are chosen."""
    chosen = standing[0]
    for option in standing:
        model, gain, luck = option.found.model, _gain(option, chosen), _luck(growth, option, chosen)
        if 0.0 < gain < luck:
            yield decisions.record_larger_friction(model, option.laws, gain, luck)
            continue
        lead = criterion(option.found, 1.0, growth.trials) - criterion(chosen.found, 1.0, growth.trials)
        yield decisions.record_friction(model, option.laws, lead, option is chosen)


def _options(growth: GrowthByPlace, joint: str) -> Iterator[Friction]:
    """The laws of dry friction at a `joint`, beside viscous friction and alone, that may stand to first order."""
    problem, best = growth.problem, growth.best
    laws = [law for law in growth.effects if law.at == joint and law.group == DRY_FRICTION]
    for rest, slopes in _without_dry_friction(growth, joint):
        beside = Beside(problem, len(rest.effects), rest.vector, slopes, *np.linalg.qr(slopes))
        seen = slopes[: problem.rows]
        at_rest = Fit(rest, problem.residual(rest), slopes, posterior(problem, rest, seen.T @ seen), best.data_rows)
        for look in _that_may_stand(growth, screen(problem, best, laws, at_rest)):
            found = beside.fit(rest.with_effects([look.effect]), CONVERGED)
            found = fit_shape_beside(beside, found, CONVERGED)
            yield Friction(found, tuple(law for law in found.model.effects if is_friction(law) and law.at == joint))


def _that_may_stand(growth: GrowthByPlace, looks: Sequence[Candidate]) -> list[Candidate]:
    """The `looks` without those that to first order explain hardly more than a simpler law that they contain."""
    gain = {look.effect.name: look.gain for look in looks}
    least = (1.0 - FIRST_ORDER_SHORTFALL) * growth.threshold(1)
    return [
        look for look in looks if all(look.gain - gain.get(simpler, 0.0) >= least for simpler in look.effect.narrows)
    ]


def _without_dry_friction(growth: GrowthByPlace, joint: str) -> Iterator[tuple[Model, Array]]:
    """The explanation without dry friction at a `joint`, with viscous friction there and without; and its slopes."""
    best = growth.best
    dry = next(effect for effect in best.model.effects if effect.at == joint and effect.group == DRY_FRICTION)
    rest, slopes = _less(best.model, best.jacobian, dry)
    viscous = [law for law in rest.effects if law.at == joint and law.name == JointViscousFriction.name]
    if viscous:
        yield rest, slopes
        yield _less(rest, slopes, viscous[0])
        return
    yield rest, slopes
    for law in growth.beside(rest):
        if law.at == joint and law.name == JointViscousFriction.name:
            more = rest.with_effects([law.with_values(law.vector)])
            added = growth.problem.effect_columns(more, len(rest.effects))
            yield more, np.hstack([slopes, added])


def _less(model: Model, slopes: Array, effect: Effect) -> tuple[Model, Array]:
    """A model without one of its effects, and its slopes (R + n, m)."""
    own = strengths_at(model, model.effects.index(effect))
    return model.without(effect), np.delete(slopes, own, axis=1)
