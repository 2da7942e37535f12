"""How well the numbers of a fit are known, where χ² is not a parabola: as far as it hardly rises."""

import numpy as np

from drake_cafim.diagnosis.fitting import NOTHING_KNOWN, Fit
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.typing import Array

REACH = 1.96
"""Standard deviations within which a number is 95 times of a hundred."""
PARABOLA = 0.75
"""Of the rise that slopes promise, from which on they are believed."""
DOUBLINGS, FOLLOWED = 6, 2
"""Of a step, and looks at each for where the other numbers go."""


def standard_deviations(problem: Problem, one: Fit, scale: float) -> Array:
    """(n + k,) of unknowns and strengths, where what is left is `scale` times the noise.

    As slopes at the fit have it, but for a strength of which 1.96 of these raise χ² by less than 1.96²: it reaches to
    where χ² does so, on the farther side, the other numbers following as slopes would have them (after Venzon,
    Moolgavkar, Applied Statistics 37(1), 1988, profile likelihood).
    """
    std = one.std * np.sqrt(scale)
    first = len(one.model.unknown)
    for index in range(first, len(std)):
        if np.isfinite(std[index]) and one.covariance[index, index] < NOTHING_KNOWN:
            reaches = [_reach(problem, one, index, side * REACH * std[index], scale) for side in (-1.0, 1.0)]
            std[index] = max(std[index], *(abs(reach) / REACH for reach in reaches))
    return np.asarray(std)


def _reach(problem: Problem, one: Fit, index: int, step: float, scale: float) -> float:
    """How far from the fit χ² has risen by 1.96² times `scale`; nothing where it does so within `step`."""
    wanted, known, reached = REACH * float(np.sqrt(scale)), 0.0, 0.0
    if _rise(problem, one, index, step, 1) > PARABOLA * wanted**2:
        return 0.0
    for _ in range(DOUBLINGS):
        rise = _rise(problem, one, index, step, FOLLOWED)
        if not np.isfinite(rise):
            break
        risen = float(np.sqrt(max(rise, 0.0)))
        if risen >= wanted:
            return reached + (step - reached) * (wanted - known) / (risen - known)
        known, reached, step = risen, step, 2.0 * step
    return reached


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
