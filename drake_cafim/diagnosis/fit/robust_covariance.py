"""Significance where the noise model does not hold: covariance from the residual's own blocks."""

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import NOISE_STD_TOLERANCE, WINDOWS_PER_BLOCK
from drake_cafim.typing import Array

KNOWN = 1e8
"""Variances, in units of what a number's would be were the others known, up to which a direction is known at all:
slopes are differences, and right to no more than the root of what rounding leaves."""
ROUNDING = 1e-12
"""Of the largest variance."""
LEAST = 1e-6
"""Of the covariance under the stated noise, which is kept: what lies within one block, as a push, has no score there
at the minimum, and the sandwich is zero but for rounding."""


def _sizes(fitted: Fit) -> Array:
    """(n,) how far the rows move with each number."""
    size = np.linalg.norm(fitted.jacobian, axis=0)
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _factors(fitted: Fit) -> tuple[Array, Array]:
    """F (n, a) and G (n, b) with FFᵀ + GGᵀ the covariance under the stated noise; G are directions that are not known.

    Those stay in: a number that is known together with another alone is not known, and what says nothing is not exact.
    """
    size = _sizes(fitted)
    spread, axes = np.linalg.eigh(fitted.covariance * np.outer(size, size))
    factor = axes * np.sqrt(np.clip(spread, 0.0, None)) / size[:, None]
    known = spread < KNOWN
    return factor[:, known], factor[:, ~known]


def _block_factor(problem: Problem, fitted: Fit, known: Array) -> Array:
    """Factor (n, c) of a covariance of what is `known` (n, a) that allows for whatever correlation blocks of time have.

    The sandwich (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with g_b = J_bᵀ z_b over blocks of four adequacy blocks
    (Liang, Zeger, Biometrika 73(1), 1986), less each block's part of their sum: what that is, is no chance, but what
    priors, and noise in the regressors, are known to make it.
    """
    n = fitted.jacobian.shape[1]
    scores, sizes, start = [], [], 0
    for _, z in by_run(problem, fitted.residual[: problem.rows]):
        step = 4 * WINDOWS_PER_BLOCK * z.shape[1]
        for first in range(0, z.size, step):
            stop = min(first + step, z.size)
            rows = slice(start + first, start + stop)
            scores.append(fitted.jacobian[rows].T @ fitted.residual[rows])
            sizes.append(stop - first)
        start += z.size
    varying = np.array(scores) - np.outer(sizes, np.sum(scores, axis=0)) / start
    meat = varying.T * np.sqrt(len(scores) / max(len(scores) - n, 1))
    return np.hstack([known @ (known.T @ meat), np.sqrt(LEAST) * known])


def _distance(difference: Array, factor: Array, alone: Array) -> float:
    """dᵀ (FFᵀ)⁻¹ d of a difference (c,) with `factor` F (c, m), along what is known; `alone` (c,) are the units.

    Directions of the difference itself are judged, all that is not known of the numbers reckoned with: one along which
    nothing is known is worth nothing, and the others are left with their marginal variance.
    """
    # a number that moves nothing, such as the rest of a spring without stiffness, says nothing
    unit = np.where(alone > 0.0, np.sqrt(alone), 1.0)
    axes, root, _ = np.linalg.svd(factor / unit[:, None], full_matrices=False)
    spread = root**2
    seen = spread < KNOWN
    seen &= spread > ROUNDING * np.max(spread[seen], initial=0.0)
    along = axes[:, seen].T @ (difference / unit)
    return float(np.sum(along**2 / spread[seen]))


def blockwise_std(problem: Problem, fitted: Fit) -> Array:
    """(n,) of unknowns and strengths, with whatever correlation blocks of time have."""
    known, nothing = _factors(fitted)
    return np.asarray(np.linalg.norm(np.hstack([_block_factor(problem, fitted, known), nothing]), axis=1))


def wald_p_value(problem: Problem, fitted: Fit, key: tuple[str, str]) -> float:
    """p-value of "this effect is absent", see `wald_statistic`."""
    statistic, freedom = wald_statistic(problem, fitted, key)
    return float(chi2.sf(statistic, freedom))


def wald_statistic(problem: Problem, fitted: Fit, key: tuple[str, str]) -> tuple[float, int]:
    """χ² of "this effect is absent" and its degrees of freedom, by the larger of the two covariances of the numbers.

    What only says how an effect looks where it is there (where a mass is, how fast a friction falls) proves nothing,
    and neither does what no row sees, such as a push along a link, nor an echo of noise.
    """
    if fitted.echo:
        return 0.0, 1
    start = len(fitted.model.unknown)
    for effect in fitted.model.effects:
        stop = start + len(effect.strengths)
        if effect.key == key:
            part = slice(start, stop)
            difference, slope = effect.vanishing()
            alone = slope**2 @ (1.0 / _sizes(fitted)[part] ** 2)
            known, nothing = _factors(fitted)
            factors = (np.hstack([one, nothing]) for one in (known, _block_factor(problem, fitted, known)))
            statistics = [_distance(difference, slope @ one[part], alone) for one in factors]
            return min(statistics) / (1.0 + NOISE_STD_TOLERANCE) ** 2, len(difference)
        start = stop
    raise KeyError(key)
