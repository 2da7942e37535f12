"""Whether the recordings determine the strengths of an effect, and the simpler law where they do not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.evidence import criterion, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.posterior import NOTHING_KNOWN
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std
from drake_cafim.diagnosis.fit.screening import Candidate, screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.thresholds import LEAST_STRENGTH_STDS, UNDETERMINED_STD_SHARE
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.numerics.rounding import short
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Descent:
    """A law that is not named, and the simpler `law`, or None, in its place.

    Nothing is known of its size, for a `reason` as a clause; or the simpler one explains as much: −2 ln likelihood is
    lower with it by a `gain` only, where noise alone makes up to `luck` of it. Then the reason is empty.
    """

    effect: Effect
    reason: str
    law: Effect | None
    gain: float | None = None
    luck: float | None = None


AT_BOUND = 1e-9
"""Distance from a bound, relative to the strength's size, up to which it counts as reached."""
UNSEEN_STD = 0.5 * float(np.sqrt(NOTHING_KNOWN))
"""Standard deviation, by linearisation, of a strength that changes nothing in the recordings."""


def undetermined(effect: Effect, std: Array, linear_std: Array) -> tuple[str, float, float] | None:
    """A strength whose standard deviation is too large a share of what it may be: its name, the std and that size.

    That size is the width of its bounds or, where they are not finite, the larger of its value and its typical size,
    and at least that of each of the effect's strengths in the same unit: of friction by direction and of components of
    a force, the small one is known where it is known to be small beside the other. `std` and `linear_std` (k,) are
    those of the effect's strengths, the second by linearisation alone.

    A component that changes nothing in the recordings, as that of a force along the axis of the only joint, says
    nothing against the others.
    """
    seen = bool(np.any(linear_std < UNSEEN_STD))
    by_unit: dict[str, float] = {}
    for strength in effect.strengths:
        own = max(abs(effect.values[strength.name]), strength.typical)
        by_unit[strength.unit] = max(own, by_unit.get(strength.unit, 0.0))
    for strength, deviation, linear in zip(effect.strengths, std, linear_std, strict=True):
        if seen and linear >= UNSEEN_STD:
            continue
        width = strength.upper - strength.lower
        size = width if np.isfinite(width) else by_unit[strength.unit]
        if not deviation <= UNDETERMINED_STD_SHARE * size:
            return strength.name, float(deviation), float(size)
    return None


def undetermined_in(found: Fit, effect: Effect, std: Array | None = None) -> tuple[str, float, float] | None:
    """`undetermined` of an effect of a fit, by the fit's standard deviations or by `std` (n + k,)."""
    std, own = found.std if std is None else std, _strengths_of(found, effect)
    return undetermined(effect, std[own], found.std[own])


def strength_at_bound(effect: Effect) -> str | None:
    """Name of a strength that ended at one of its bounds, or beyond: then a simpler law says the same."""
    for strength in effect.strengths:
        value, (lower, upper) = effect.values[strength.name], effect.bounds_of(strength)
        reach = AT_BOUND * max(abs(value), strength.typical)
        if value - lower <= reach or upper - value <= reach:
            return strength.name
    return None


def is_unknown(found: Fit, effect: Effect) -> bool:
    """Whether the size of an effect of a fit is not known: a strength ends at a bound, or is not determined."""
    return strength_at_bound(effect) is not None or undetermined_in(found, effect) is not None


def is_simpler(law: Effect, than: Effect) -> bool:
    """Whether a `law` is of the group of another one, at its place, and has fewer strengths."""
    return than.excludes(law) and len(law.strengths) < len(than.strengths)


def simpler_laws(
    problem: SearchProblem,
    found: Fit,
    larger: Sequence[Effect],
    laws: Sequence[Effect],
    gain: Callable[[Candidate], float],
) -> list[Effect]:
    """For each of the `larger` laws the simpler one among `laws`, if any, that is worth most beside `found`.

    What a candidate is worth is its `gain`; none is worth less than nothing.
    """
    chosen = []
    for effect in larger:
        looks = screen(problem, found, [law for law in laws if is_simpler(law, effect)])
        worth = [look for look in looks if gain(look) > 0.0]
        chosen += [max(worth, key=gain).effect] if worth else []
    return chosen


def descend(problem: SearchProblem, found: Fit, laws: Sequence[Effect]) -> tuple[Fit, list[Descent]]:
    """The fit without laws of which a strength is not determined or ends at a bound, and what replaced them.

    A law's simpler ones are those of its group among `laws` that have fewer strengths: Coulomb friction where nothing
    is known of the static torque. They are nested in it, so that little is lost. Where none is determined either, the
    law is left out: nothing is known of its size.
    """
    descents: list[Descent] = []
    while (unknown := _first_unknown(problem, found)) is not None:
        present, reason = unknown
        rest, known = unbiased_fit(problem, found.model.without(present)), []
        for look in screen(problem, rest, [law for law in laws if is_simpler(law, present)]):
            shaped = fit_shapes(problem, fit(problem, rest.model.with_effects([look.effect])))
            fitted = unbiased_fit(problem, shaped.model)
            if not fitted.echo and reason_against(problem, fitted, fitted.model.effects[-1]) is None:
                known.append(fitted)
        found = min(known, key=lambda fitted: criterion(fitted, scale_of(fitted), 1)) if known else rest
        descents.append(Descent(present, reason, found.model.effects[-1] if known else None))
    return found, descents


def _first_unknown(problem: SearchProblem, found: Fit) -> tuple[Effect, str] | None:
    """The first effect of a fit whose size is not known, and why; those before may depend on one that was left out."""
    for effect in found.model.effects:
        reason = reason_against(problem, found, effect)
        if reason is not None:
            return effect, reason
    return None


def reasons_against(problem: SearchProblem, found: Fit) -> list[tuple[Effect, str]]:
    """The effects of a fit whose size is not known by a report's standard deviations, and why, as a clause."""
    std = _std(problem, found)
    reasons = [(effect, _reason_by_std(found, effect, std)) for effect in found.model.effects]
    return [(effect, reason) for effect, reason in reasons if reason is not None]


def reason_against(problem: SearchProblem, found: Fit, effect: Effect) -> str | None:
    """Why the size of an effect of a fit is not known, as a clause; None where it is."""
    if strength_at_bound(effect) is not None:
        return _reason_by_std(found, effect, found.std)
    return _reason_by_std(found, effect, _std(problem, found))


def _reason_by_std(found: Fit, effect: Effect, std_of_all: Array) -> str | None:
    bound = strength_at_bound(effect)
    if bound is not None:
        return f"its {bound.replace('_', ' ')} ends at a bound or beyond it, {short(effect.values[bound])}"
    wide = undetermined_in(found, effect, std_of_all)
    if wide is None:
        return _reason_of_absence(found, effect, std_of_all)
    strength, std, size = wide
    words = f"the standard deviation of its {strength.replace('_', ' ')} is {short(std)}, and what it may be spans "
    return f"{words}{short(size)}"


def _reason_of_absence(found: Fit, effect: Effect, std: Array) -> str | None:
    """Why an effect, or what it has beyond a simpler law, may as well be absent, as a clause; None where it may not.

    One of its strengths that are its size must differ from none. Each must, of a group's law, that is absent at
    infinity: a limit of the effort that falls with speed is a constant one where the no-load speed is infinite.
    """
    sized, differs = False, False
    for strength, deviation in zip(effect.strengths, std[_strengths_of(found, effect)], strict=True):
        value, own = effect.values[strength.name], float(deviation)
        size = value if strength.inverse else value - strength.nominal
        near = abs(size) < LEAST_STRENGTH_STDS * own
        if near and (len(effect.strengths) == 1 or (effect.group and strength.inverse)):
            words = f"its {strength.name.replace('_', ' ')} is {short(value)} ± {short(own, 2)}"
            return f"{words}, within {LEAST_STRENGTH_STDS:g} standard deviations of its absence"
        if strength.amplitude or strength.inverse:
            sized, differs = True, differs or not near
    if sized and not differs:
        return f"each of its strengths is within {LEAST_STRENGTH_STDS:g} standard deviations of its absence"
    return None


def _strengths_of(found: Fit, effect: Effect) -> slice:
    """Where the strengths of an effect of a fit are among its parameters."""
    position = len(found.model.unknown)
    for other in found.model.effects:
        if other is effect:
            break
        position += len(other.strengths)
    return slice(position, position + len(effect.strengths))


def _std(problem: SearchProblem, found: Fit) -> Array:
    """(n + k,) standard deviations as a report gives them; by blocks of time where those cannot be computed."""
    std = compute(lambda: standard_deviations(problem, found, scale_of(found)))
    return np.maximum(found.std, blockwise_std(problem, found)) if isinstance(std, NotComputable) else std
