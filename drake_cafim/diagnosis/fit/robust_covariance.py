"""Wald tests, standard deviations and a comparison of laws that hold for a correlated residual: by blocks of time."""

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import NOISE_STD_TOLERANCE, WINDOWS_PER_BLOCK
from drake_cafim.typing import Array

LARGEST_VARIANCE = 1e8
"""Variance of a direction, over that with all others known, up to which the direction is determined: slopes are finite
differences, exact to the square root of rounding errors only."""
ROUNDING = 1e-12
"""Variance over the largest one that is rounding error."""
LEAST_SHARE = 1e-6
"""Share of the covariance under the stated noise that is added to the sandwich, which vanishes but for rounding for an
effect within a single block, as a push: its score there is zero at the minimum."""


def _sizes(fitted: Fit) -> Array:
    """(n,) norm of each column of the Jacobian; 1 where it is zero."""
    size = np.linalg.norm(fitted.jacobian, axis=0)
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _factors(fitted: Fit) -> tuple[Array, Array]:
    """F (n, a) and G (n, b) with FFᵀ + GGᵀ the covariance under the stated noise; G spans undetermined directions.

    G must be kept: where only the sum of two parameters is determined, neither of them is.
    """
    size = _sizes(fitted)
    spread, axes = np.linalg.eigh(fitted.covariance * np.outer(size, size))
    factor = axes * np.sqrt(np.clip(spread, 0.0, None)) / size[:, None]
    known = spread < LARGEST_VARIANCE
    return factor[:, known], factor[:, ~known]


def _block_factor(problem: Problem, fitted: Fit, known: Array) -> Array:
    """Factor (n, c) of a covariance along `known` directions (n, a) that holds for any correlation within blocks.

    The sandwich (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with the scores g_b = J_bᵀ z_b of blocks of four adequacy blocks
    (Liang, Zeger, Biometrika 73(1), 1986). Each block's share of Σ_b g_b is subtracted first: that sum is not zero
    because of priors and of the correction for noise in the regressors, not by chance.
    """
    n = fitted.jacobian.shape[1]
    blocks = blocks_of_time(problem, fitted)
    scores = [fitted.jacobian[rows].T @ fitted.residual[rows] for rows in blocks]
    sizes = [rows.stop - rows.start for rows in blocks]
    varying = np.array(scores) - np.outer(sizes, np.sum(scores, axis=0)) / sum(sizes)
    # where there are more parameters than blocks, each takes its degree of freedom from the rows of its own joint only
    freedom = max(len(scores) - n, len(scores) / 2)
    meat = varying.T * np.sqrt(len(scores) / freedom)
    return np.hstack([known @ (known.T @ meat), np.sqrt(LEAST_SHARE) * known])


def blocks_of_time(problem: Problem, fitted: Fit) -> list[slice]:
    """The rows of each block of four adequacy blocks of a recording; its last block may be shorter."""
    blocks, start = [], 0
    for _, z in by_run(problem, fitted.residual[: problem.rows]):
        step = 4 * WINDOWS_PER_BLOCK * z.shape[1]
        blocks += [slice(start + first, start + min(first + step, z.size)) for first in range(0, z.size, step)]
        start += z.size
    return blocks


def _noise_factor(problem: Problem, fitted: Fit, known: Array) -> Array | None:
    """Factor (n, K) of the covariance along `known` directions (n, a) by realisations of the noise.

    The sandwich (JᵀJ)⁻¹ (Σ_k g_k g_kᵀ/K) (JᵀJ)⁻¹ with g_k = Jᵀ z_k of the rows z_k that noise alone makes; None where
    it is Gaussian.
    """
    realised = problem.realised_noise
    if realised is None:
        return None
    scores = fitted.jacobian[: problem.rows].T @ realised.rows / np.sqrt(realised.rows.shape[1])
    return np.hstack([known @ (known.T @ scores), np.sqrt(LEAST_SHARE) * known])


def _distance(difference: Array, factor: Array, alone: Array) -> float:
    """dᵀ (FFᵀ)⁺ d of a `difference` d (c,) with `factor` F (c, m), over determined directions; `alone` (c,) scales d.

    Undetermined directions of d add nothing; the others count with their marginal variance.
    """
    # a strength that moves nothing, as the rest position of a spring without stiffness, has no scale
    unit = np.where(alone > 0.0, np.sqrt(alone), 1.0)
    axes, root, _ = np.linalg.svd(factor / unit[:, None], full_matrices=False)
    spread = root**2
    seen = spread < LARGEST_VARIANCE
    seen &= spread > ROUNDING * np.max(spread[seen], initial=0.0)
    along = axes[:, seen].T @ (difference / unit)
    return float(np.sum(along**2 / spread[seen]))


def blockwise_std(problem: Problem, fitted: Fit) -> Array:
    """(n + k,) standard deviations that hold for any correlation of the residual within blocks of time."""
    known, nothing = _factors(fitted)
    return np.asarray(np.linalg.norm(np.hstack([_block_factor(problem, fitted, known), nothing]), axis=1))


def realised_std(problem: Problem, fitted: Fit) -> Array:
    """(n + k,) standard deviations by realisations of the noise; 0 where it is Gaussian."""
    known, _ = _factors(fitted)
    factor = _noise_factor(problem, fitted, known)
    return np.zeros(len(fitted.model.vector)) if factor is None else np.asarray(np.linalg.norm(factor, axis=1))


def wald_p_value(problem: Problem, fitted: Fit, key: tuple[str, str]) -> float:
    """p-value of "this effect is absent", see `wald_statistic`."""
    statistic, freedom = wald_statistic(problem, fitted, key)
    return float(chi2.sf(statistic, freedom))


def wald_statistic(problem: Problem, fitted: Fit, key: tuple[str, str]) -> tuple[float, int]:
    """χ² of "the effect with this `key` is absent" and its degrees of freedom; the smaller of two Wald statistics.

    One is by the covariance under the stated noise, the other by blocks of time. Only strengths that make the effect
    vanish count, not its shape (where a mass is, how fast a friction falls); an artefact of noise has 0. Raises
    `KeyError` where the fit has no such effect.
    """
    effect = next((effect for effect in fitted.model.effects if effect.key == key), None)
    if effect is None:
        raise KeyError(key)
    if fitted.echo:
        return 0.0, 1
    return min(wald_statistics(problem, fitted, key)) / (1.0 + NOISE_STD_TOLERANCE) ** 2, len(effect.vanishing()[0])


def wald_statistics(problem: Problem, fitted: Fit, key: tuple[str, str]) -> tuple[float, float]:
    """χ² of "the effect with this `key` is absent", by the stated noise and by blocks of time."""
    effect = next((effect for effect in fitted.model.effects if effect.key == key), None)
    if effect is None:
        raise KeyError(key)
    return contrast_statistics(problem, fitted, key, *effect.vanishing())


def contrast_statistics(
    problem: Problem, fitted: Fit, key: tuple[str, str], difference: Array, slope: Array
) -> tuple[float, float]:
    """χ² of "`difference` (c,) is zero", by the stated noise and by blocks of time.

    `slope` (c, k) is its Jacobian in the strengths of the effect with this `key`. Where noise is not Gaussian, the
    first is the smaller of that by its covariance and that by realisations of it.
    """
    start = len(fitted.model.unknown)
    for effect in fitted.model.effects:
        stop = start + len(effect.strengths)
        if effect.key == key:
            part = slice(start, stop)
            alone = slope**2 @ (1.0 / _sizes(fitted)[part] ** 2)
            known, nothing = _factors(fitted)
            found = (known, _noise_factor(problem, fitted, known), _block_factor(problem, fitted, known))
            factors = [np.hstack([factor, nothing]) for factor in found if factor is not None]
            *by_noise, by_blocks = (_distance(difference, slope @ factor[part], alone) for factor in factors)
            return min(by_noise), by_blocks
        start = stop
    raise KeyError(key)


def p_value_of_no_better(problem: Problem, best: Fit, other: Fit) -> float:
    """p-value of "`other` predicts at least as well as `best`", both fitted to the rows of `problem`.

    With d_b the difference of their χ² in block of time b, B blocks and D = Σ d_b, where that of the `other` has the
    difference of their numbers of parameters added (Akaike), D/(√B s_d) is Student's t with B − 1 degrees of freedom
    where both predict equally well (Vuong, Econometrica 57(2), 1989). The difference of two wrong likelihoods, large as
    it may be, is a matter of chance as long as it has another sign from block to block.
    """
    blocks = blocks_of_time(problem, best)
    squares = other.residual**2 - best.residual**2
    differences = np.array([np.sum(squares[rows]) for rows in blocks])
    total = np.sum(differences) + len(other.model.vector) - len(best.model.vector)
    spread = np.sqrt(len(blocks)) * np.std(differences, ddof=1) if len(blocks) > 1 else 0.0
    if spread == 0.0:
        return 0.5 if len(blocks) < 2 or total == 0.0 else float(total < 0.0)
    return float(student.sf(total / spread, len(blocks) - 1))
