"""Significance where the noise model does not hold: covariance from the residual's own blocks."""

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.adequacy import BLOCK, by_run
from drake_cafim.diagnosis.fitting import Fit
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.typing import Array

LEAST = 1e-6
"""Of the covariance under the stated noise, which is kept: what lies within one block, as a push, has no score there
at the minimum, and the sandwich is zero but for rounding."""


def block_covariance(problem: Problem, fitted: Fit) -> Array:
    """Covariance (n, n) of the numbers of `fitted` that allows for whatever correlation blocks of time have.

    The sandwich (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with g_b = J_bᵀ z_b over blocks of four adequacy blocks
    (Liang, Zeger, Biometrika 73(1), 1986).
    """
    bread = fitted.covariance
    n = fitted.jacobian.shape[1]
    meat = np.zeros((n, n))
    start, blocks = 0, 0
    for _, z in by_run(problem, fitted.residual[: problem.rows]):
        step = 4 * BLOCK * z.shape[1]
        for first in range(0, z.size, step):
            stop = min(first + step, z.size)
            rows = slice(start + first, start + stop)
            g = fitted.jacobian[rows].T @ fitted.residual[rows]
            meat += np.outer(g, g)
            blocks += 1
        start += z.size
    meat *= blocks / max(blocks - n, 1)
    sandwich = bread @ meat @ bread
    return np.asarray(sandwich + LEAST * bread, dtype=float)


def wald_p_value(problem: Problem, fitted: Fit, key: tuple[str, str]) -> float:
    """p-value of "this effect is absent", by the larger of the two covariances of the numbers.

    What only says how an effect looks where it is there (where a mass is, how fast a friction falls) proves nothing.
    """
    start = len(fitted.model.unknown)
    for effect in fitted.model.effects:
        stop = start + len(effect.strengths)
        if effect.key == key:
            part = slice(start, stop)
            difference, slope = effect.vanishing()
            statistics = [
                float(
                    difference
                    @ np.linalg.pinv(slope @ one[part, part] @ slope.T, rcond=1e-18, hermitian=True)
                    @ difference
                )
                for one in (fitted.covariance, block_covariance(problem, fitted))
            ]
            return float(chi2.sf(min(statistics), len(difference)))
        start = stop
    raise KeyError(key)
