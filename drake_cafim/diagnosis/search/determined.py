"""Whether the recordings determine the strengths of an effect, and the simpler law where they do not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.evidence import criterion, scale_of
from drake_cafim.diagnosis.fit.fitting import NOTHING_KNOWN, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.screening import screen
from drake_cafim.diagnosis.thresholds import UNDETERMINED_STD_SHARE
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Descent:
    """A law of which a `strength` is not determined, its std beside the `size` it may have, and the simpler `law`."""

    effect: Effect
    strength: str
    std: float
    size: float
    law: Effect


UNSEEN_STD = 0.5 * float(np.sqrt(NOTHING_KNOWN))
"""Standard deviation, by linearisation, of a strength that changes nothing in the recordings."""


def undetermined(effect: Effect, std: Array, linear_std: Array) -> tuple[str, float, float] | None:
    """A strength whose standard deviation is too large a share of what it may be: its name, the std and that size.

    That size is the width of its bounds or, where they are not finite, the larger of its value and its typical size.
    `std` and `linear_std` (k,) are those of the effect's strengths, the second by linearisation alone.

    A component that changes nothing in the recordings, as that of a force along the axis of the only joint, says
    nothing against the others.
    """
    seen = bool(np.any(linear_std < UNSEEN_STD))
    for strength, deviation, linear in zip(effect.strengths, std, linear_std, strict=True):
        if seen and linear >= UNSEEN_STD:
            continue
        value, width = effect.values[strength.name], strength.upper - strength.lower
        size = width if np.isfinite(width) else max(abs(value), strength.typical)
        if not deviation <= UNDETERMINED_STD_SHARE * size:
            return strength.name, float(deviation), float(size)
    return None


def undetermined_in(found: Fit, effect: Effect, std: Array | None = None) -> tuple[str, float, float] | None:
    """`undetermined` of an effect of a fit, by the fit's standard deviations or by `std` (n + k,)."""
    std = found.std if std is None else std
    position = len(found.model.unknown)
    for other in found.model.effects:
        own = slice(position, position + len(other.strengths))
        if other is effect:
            return undetermined(effect, std[own], found.std[own])
        position = own.stop
    return None


def descend(problem: SearchProblem, found: Fit, laws: Sequence[Effect]) -> tuple[Fit, list[Descent]]:
    """The fit in which simpler laws replace those of which a strength is not determined, and which did.

    A law's simpler ones are those of its group among `laws` that have fewer strengths: Coulomb friction where nothing
    is known of the static torque. They are nested in it, so that little is lost. A law without a simpler one that is
    determined stays.
    """
    descents: list[Descent] = []
    for effect in found.model.effects:
        wide = undetermined_in(found, effect, _std_by_blocks(problem, found))
        simpler = [law for law in laws if effect.excludes(law) and len(law.strengths) < len(effect.strengths)]
        if wide is None or not simpler:
            continue
        rest, known = unbiased_fit(problem, found.model.without(effect)), []
        for look in screen(problem, rest, simpler):
            shaped = fit_shapes(problem, fit(problem, rest.model.with_effects([look.effect])))
            fitted = unbiased_fit(problem, shaped.model)
            law = fitted.model.effects[-1]
            if not fitted.echo and undetermined_in(fitted, law, _std_by_blocks(problem, fitted)) is None:
                known.append((fitted, law))
        if known:
            found, law = min(known, key=lambda entry: criterion(entry[0], scale_of(entry[0]), 1))
            descents.append(Descent(effect, *wide, law))
    return found, descents


def _std_by_blocks(problem: SearchProblem, found: Fit) -> Array:
    """(n + k,) standard deviations of a fit, where the residual is correlated as well."""
    return np.maximum(found.std, blockwise_std(problem, found))
