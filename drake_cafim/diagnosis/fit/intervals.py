"""Standard deviations of fitted parameters where χ² is not a parabola: half widths over which it hardly rises."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.posterior import LEAST_INFORMATION, NOTHING_KNOWN
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std, realised_std, wald_p_value
from drake_cafim.diagnosis.thresholds import EFFECT_SHOWN_P_VALUE, INTERVAL_REACH_IN_STDS, PARABOLIC_RISE_SHARE
from drake_cafim.effects.effect import Effect
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DOUBLINGS, REFINEMENTS = 6, 2
"""Largest number of doublings of a step without a bound, and of iterations for the other parameters at each."""


def standard_deviations(problem: Problem, fit: Fit, scale: float) -> Array:
    """(n + k,) of unknowns and strengths, where the residual is `scale` times the noise.

    The largest of three by linearisation: under the stated noise, by realisations of it where it is not Gaussian
    (`realised_std`), and by blocks of the residual (`blockwise_std`). If χ² rises by less than 1.96² at 1.96 of these,
    a strength's interval extends to where it does so on the farther side, or to the strength's bound, the other
    parameters adapting (profile likelihood; after Venzon, Moolgavkar, Applied Statistics 37(1), 1988). If an effect
    with further shape parameters is not significant, its fit is one of many minima by noise (Davies, Biometrika 74(1),
    1987): its shape is unknown, and the std of an amplitude is its value.
    """
    std = np.maximum(np.maximum(fit.std, realised_std(problem, fit)) * np.sqrt(scale), blockwise_std(problem, fit))
    std = np.hypot(std, np.sqrt(doubt_of_settled(problem.scene, fit)))
    n = len(fit.model.unknown)
    if n:
        # what was known before the recordings is still known, whatever the noise
        std[:n] = np.minimum(std[:n], problem.prior_std(fit.model))
    for index in range(n, len(std)):
        bounds = _bounds(fit, index)
        if 0.0 < std[index] < np.inf and fit.covariance[index, index] < NOTHING_KNOWN:
            sides = zip(
                (-INTERVAL_REACH_IN_STDS * float(std[index]), INTERVAL_REACH_IN_STDS * float(std[index])),
                bounds,
                strict=True,
            )
            reaches = [_reach(problem, fit, index, step, bound, scale) for step, bound in sides]
            std[index] = max(std[index], *(abs(reach) / INTERVAL_REACH_IN_STDS for reach in reaches))
        # a strength that the recordings do not determine is known by its bounds
        std[index] = min(std[index], max(abs(bound) for bound in bounds) / INTERVAL_REACH_IN_STDS)
    return np.asarray(np.maximum(std, _least_std(problem, fit)))


def changes_beside(problem: Problem, found: Fit, effects: Sequence[Effect]) -> Array:
    """(n + k,) root sum of squares of the changes of the parameters of `found` where each of `effects` stands beside.

    Whether an effect is there that stands out of the noise and has no name is not known: the others' numbers are as
    uncertain as that makes them. A fit that is no better with an effect says nothing.
    """
    changes = np.zeros(len(found.model.vector))
    for effect in effects:
        beside = unbiased_fit(problem, found.model.with_effects([effect]))
        if beside.chi_square < found.chi_square and not beside.echo:
            changes = np.hypot(changes, beside.model.vector[: len(changes)] - found.model.vector)
    return changes


def unknowns_std(scene: Scene, fit: Fit) -> Array:
    """(n,) standard deviations of the unknowns under the stated noise, those settled before known no better by a fit.

    `scene` is the one whose priors the fit had.
    """
    n = len(scene.unknown)
    return np.asarray(np.hypot(fit.std, np.sqrt(doubt_of_settled(scene, fit)))[:n])


def doubt_of_settled(scene: Scene, fit: Fit) -> Array:
    """(n + k,) variances to be added since the priors of some unknowns are of the same recordings as the rows.

    Simulations of the recordings settled these unknowns s with covariance P (diagonal). The rows are the same samples
    once more: taken as further ones, they would make s known far too well. So s keeps P, and whatever depends on it is
    as uncertain as that makes it (a cut; Plummer, Statistics and Computing 25, 2015): with the covariance C of the fit,

        C + A (P − C_ss)₊ Aᵀ,   A = C_·s C_ss⁻¹,

    of which this is the diagonal of the second term. It is zero where nothing was settled.
    """
    added = np.zeros(len(fit.model.vector))
    at = [i for i, unknown in enumerate(scene.unknown) if unknown.settled]
    if not at:
        return added
    # in units of P the part that counts twice is that of the eigenvalues below one
    prior = scene.priors.std[at]
    own = fit.covariance[np.ix_(at, at)] / np.outer(prior, prior)
    known, axes = np.linalg.eigh(own)
    known = np.maximum(known, LEAST_INFORMATION * max(1.0, float(known[-1])))
    along = (fit.covariance[:, at] / prior) @ axes / known * np.sqrt(np.maximum(1.0 - known, 0.0))
    return np.asarray(np.sum(along**2, axis=1))


def _least_std(problem: Problem, fit: Fit) -> Array:
    """(n + k,) lower bounds of the standard deviations of insignificant effects; zero of all others."""
    least, start = np.zeros(len(fit.model.vector)), len(fit.model.unknown)
    for effect in fit.model.effects:
        looks = not all(strength.amplitude for strength in effect.strengths)
        if looks and wald_p_value(problem, fit, effect.key) > EFFECT_SHOWN_P_VALUE:
            for index, strength in enumerate(effect.strengths, start):
                value = float(fit.model.vector[index])
                farthest = min(
                    max(abs(bound) for bound in _bounds(fit, index)) / INTERVAL_REACH_IN_STDS, np.sqrt(NOTHING_KNOWN)
                )
                least[index] = abs(value - strength.nominal) if strength.amplitude else farthest
        start += len(effect.strengths)
    return least


def _reach(problem: Problem, fit: Fit, index: int, step: float, bound: float, scale: float) -> float:
    """Distance from the fit at which χ² has risen by 1.96² · `scale`, up to the `bound`; 0 if that is within `step`."""
    wanted, known, reached = INTERVAL_REACH_IN_STDS * float(np.sqrt(scale)), 0.0, 0.0
    if abs(step) >= abs(bound) or _rise(problem, fit, index, step, 1) > PARABOLIC_RISE_SHARE * wanted**2:
        return 0.0
    for far in _steps(step, bound):
        rise = _rise(problem, fit, index, far, REFINEMENTS)
        if not np.isfinite(rise):
            break
        risen = float(np.sqrt(max(rise, 0.0)))
        if risen >= wanted:
            return reached + (far - reached) * (wanted - known) / (risen - known)
        known, reached = risen, far
    return reached


def _steps(step: float, bound: float) -> list[float]:
    """Distances that double, up to the `bound` where it is finite."""
    if not np.isfinite(bound):
        return [step * 2.0**k for k in range(DOUBLINGS)]
    return [*(step * 2.0**k for k in range(int(np.ceil(np.log2(bound / step))))), bound]


def _bounds(fit: Fit, index: int) -> tuple[float, float]:
    """Distances of a strength's lower and upper bound from the fit; infinite where there is none."""
    strengths = [strength for effect in fit.model.effects for strength in effect.strengths]
    strength, value = strengths[index - len(fit.model.unknown)], float(fit.model.vector[index])
    return min(strength.lower - value, 0.0), max(strength.upper - value, 0.0)


def _rise(problem: Problem, fit: Fit, index: int, step: float, looks: int) -> float:
    """Rise of χ² when a parameter is moved by `step` and the others adapt; infinite beyond its bounds.

    The others move as linearised at the fit, and then by a Gauss–Newton step from there in each further of the `looks`.
    """
    start, J = fit.model.vector, fit.jacobian
    # a fit corrected for shared noise is not at the minimum of χ²: the slope there is no rise
    slope = J.T @ fit.residual
    others = np.arange(len(start)) != index
    information = J[:, others].T @ J[:, others]
    moved = step * fit.covariance[:, index] / fit.covariance[index, index]
    least = np.inf
    for _ in range(looks):
        trial = fit.model.at(start + moved)
        taken = trial.vector - start
        if abs(taken[index] - step) > 1e-6 * abs(step):
            break
        residual = problem.residual(trial)
        cost = float(residual @ residual) + problem.penalty(trial) - 2.0 * float(slope @ taken)
        least = min(least, cost - fit.chi_square)
        moved = taken
        moved[others] -= np.linalg.lstsq(information, (J.T @ residual - slope)[others], rcond=1e-12)[0]
    return least
