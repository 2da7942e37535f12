"""How well the numbers of a fit are known, where χ² is not a parabola: as far as it hardly rises."""

import numpy as np

from drake_cafim.diagnosis.fit.fitting import NOTHING_KNOWN, Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std, wald_p_value
from drake_cafim.diagnosis.thresholds import EFFECT_SHOWN_P_VALUE, INTERVAL_REACH_IN_STDS, PARABOLIC_RISE_SHARE
from drake_cafim.typing import Array

DOUBLINGS, FOLLOWED = 6, 2
"""Of a step where no bound ends them, and looks at each for where the other numbers go."""


def standard_deviations(problem: Problem, one: Fit, scale: float) -> Array:
    """(n + k,) of unknowns and strengths, where what is left is `scale` times the noise.

    As slopes at the fit have it, under the stated noise or, if that is more, with what blocks of the residual show. But
    a strength of which 1.96 of these raise χ² by less than 1.96² reaches to where χ² does so, on the farther side, the
    other numbers following as slopes would have them (after Venzon, Moolgavkar, Applied Statistics 37(1), 1988, profile
    likelihood); to its bound, where χ² does not do so before. Of an effect that is not shown to be there, and may look
    in many ways, slopes are those of one of many minima that noise makes (Davies, Biometrika 74(1), 1987): nothing is
    known of how it looks, and its strengths are known to no more than what they are.
    """
    std = np.maximum(one.std * np.sqrt(scale), blockwise_std(problem, one))
    for index in range(len(one.model.unknown), len(std)):
        bounds = _bounds(one, index)
        if 0.0 < std[index] < np.inf and one.covariance[index, index] < NOTHING_KNOWN:
            sides = zip(
                (-INTERVAL_REACH_IN_STDS * float(std[index]), INTERVAL_REACH_IN_STDS * float(std[index])),
                bounds,
                strict=True,
            )
            reaches = [_reach(problem, one, index, step, bound, scale) for step, bound in sides]
            std[index] = max(std[index], *(abs(reach) / INTERVAL_REACH_IN_STDS for reach in reaches))
        # of what the recordings do not see, no more is known than its bounds
        std[index] = min(std[index], max(abs(bound) for bound in bounds) / INTERVAL_REACH_IN_STDS)
    return np.asarray(np.maximum(std, _of_what_is_not_shown(problem, one)))


def _of_what_is_not_shown(problem: Problem, one: Fit) -> Array:
    """(n + k,) least standard deviations of numbers; zero of what is shown."""
    least, start = np.zeros(len(one.model.vector)), len(one.model.unknown)
    for effect in one.model.effects:
        looks = not all(strength.amplitude for strength in effect.strengths)
        if looks and wald_p_value(problem, one, effect.key) > EFFECT_SHOWN_P_VALUE:
            for index, strength in enumerate(effect.strengths, start):
                value = float(one.model.vector[index])
                farthest = min(
                    max(abs(bound) for bound in _bounds(one, index)) / INTERVAL_REACH_IN_STDS, np.sqrt(NOTHING_KNOWN)
                )
                least[index] = abs(value - strength.nominal) if strength.amplitude else farthest
        start += len(effect.strengths)
    return least


def _reach(problem: Problem, one: Fit, index: int, step: float, bound: float, scale: float) -> float:
    """How far from the fit χ² has risen by 1.96² times `scale`, at most to its `bound`; nothing if within `step`."""
    wanted, known, reached = INTERVAL_REACH_IN_STDS * float(np.sqrt(scale)), 0.0, 0.0
    if abs(step) >= abs(bound) or _rise(problem, one, index, step, 1) > PARABOLIC_RISE_SHARE * wanted**2:
        return 0.0
    for far in _steps(step, bound):
        rise = _rise(problem, one, index, far, FOLLOWED)
        if not np.isfinite(rise):
            break
        risen = float(np.sqrt(max(rise, 0.0)))
        if risen >= wanted:
            return reached + (far - reached) * (wanted - known) / (risen - known)
        known, reached = risen, far
    return reached


def _steps(step: float, bound: float) -> list[float]:
    """Twice as far each time, up to a `bound` where there is one."""
    if not np.isfinite(bound):
        return [step * 2.0**k for k in range(DOUBLINGS)]
    return [*(step * 2.0**k for k in range(int(np.ceil(np.log2(bound / step))))), bound]


def _bounds(one: Fit, index: int) -> tuple[float, float]:
    """How far from the fit the lower and the upper bound of a strength are; infinite where there is none."""
    strengths = [strength for effect in one.model.effects for strength in effect.strengths]
    strength, value = strengths[index - len(one.model.unknown)], float(one.model.vector[index])
    return min(strength.lower - value, 0.0), max(strength.upper - value, 0.0)


def _rise(problem: Problem, one: Fit, index: int, step: float, looks: int) -> float:
    """Of χ² where a number is a `step` from the fit and the others follow; infinite beyond its bounds.

    At the first of the `looks` they are where slopes at the fit have them, then where its slopes have them there.
    """
    start, J = one.model.vector, one.jacobian
    # a fit that is corrected for shared noise does not lie where χ² is least
    slope = J.T @ one.residual
    others = np.arange(len(start)) != index
    information = J[:, others].T @ J[:, others]
    moved = step * one.covariance[:, index] / one.covariance[index, index]
    least = np.inf
    for _ in range(looks):
        trial = one.model.at(start + moved)
        taken = trial.vector - start
        if abs(taken[index] - step) > 1e-6 * abs(step):
            break
        residual = problem.residual(trial)
        cost = float(residual @ residual) + problem.penalty(trial) - 2.0 * float(slope @ taken)
        least = min(least, cost - one.chi_square)
        moved = taken
        moved[others] -= np.linalg.lstsq(information, (J.T @ residual - slope)[others], rcond=1e-12)[0]
    return least
