"""Unknown random forces at the joints as noise: their densities, estimated from the residual of a model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.fit.bounds import minimise_within, steps_within
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.thresholds import LAW_ACCURACY, UNKNOWN_FORCE_VARIANCE_SHARE
from drake_cafim.diagnosis.whitening.covariance import Whitening, row_covariance, unknown_force_factors
from drake_cafim.diagnosis.whitening.force_information import whitened_parts
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.dynamics.tree import Joint
from drake_cafim.numerics.rounding import listed, rounded
from drake_cafim.numerics.row_products import LowerEntries, SymmetricBand, lower_entries
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

MOST_STEPS, TOLERANCE = 12, 0.02
"""Largest number of scoring steps, and the relative change of the densities at which they end."""


def force_density(problem: WeakFormRows, model: Model, near: Array | None = None) -> Array:
    """(n,) density of a white force at each joint, (N m)² s or N² s: the maximum likelihood given `model`.

    The steps begin at `near` (n,), if that is given. Each density is a variance component of the rows, estimated by
    Fisher scoring and bounded below by zero (Harville, J. American Statistical Association 72(358), 1977, §4). The
    scene's unknowns follow each density to first order: those of `model` were fitted under another noise, and a mass
    that absorbed a part of one joint's force leaves, at the joints beside it, what would look like more of them.
    """
    physics = model.physics(problem.scene)
    starts = np.cumsum([run.rows for run in problem.runs])[:-1]
    recordings = []
    for run, slopes in zip(problem.runs, np.split(_slopes(problem, model), starts), strict=True):
        noise = row_covariance(run.weak, physics)
        factors = unknown_force_factors(run.weak, physics)
        recordings.append(_Recording(run.noisy_rows(physics).ravel(), run.whiten.unwhiten(slopes), noise, factors))
    # start from an upper bound: as if the rows held no noise of the channels
    density = np.sum([recording.power for recording in recordings], axis=0) / np.sum(
        [recording.size for recording in recordings], axis=0
    )
    density = density if near is None else np.minimum(density, near)
    for _ in range(MOST_STEPS):
        before = density
        score, information = _scores(problem, model, recordings, density)
        density = np.maximum(density + score / information, 0.0)
        if np.all(np.abs(density - before) <= TOLERANCE * before):
            break
    return np.asarray(density, dtype=float)


def _scores(
    problem: WeakFormRows, model: Model, recordings: Sequence["_Recording"], density: Array
) -> tuple[Array, Array]:
    """The sums over all recordings of `_Whitened.score`, with the unknowns that have their maximum at `density`."""
    whitened = [recording.whitened(density) for recording in recordings]
    change = _change_of_unknowns(problem, model, whitened)
    score, information = np.sum([own.score(change) for own in whitened], axis=0)
    return score, information


def _slopes(problem: WeakFormRows, model: Model) -> Array:
    """(R, n) derivatives of the whitened rows by the scene's unknowns; none where rows have an unknown start."""
    if not len(model.unknown) or has_unknown_start(model.physics(problem.scene)):
        return np.zeros((problem.rows, 0))
    return problem.jacobian(model)[: problem.rows, : len(model.unknown)]


def _change_of_unknowns(problem: WeakFormRows, model: Model, whitened: Sequence["_Whitened"]) -> Array:
    """(n,) change of the unknowns to the maximum of their posterior under the whitening, to first order.

    Within their bounds: beyond them they explain nothing, and the forces would be too small for what is left.
    """
    if not whitened[0].slopes.shape[1]:
        return np.zeros(0)
    std = problem.prior_std(model)
    information, gradient = np.diag(std**-2.0), problem.prior_rows(model) / std
    for own in whitened:
        information = information + own.slopes.T @ own.slopes
        gradient = gradient + own.slopes.T @ own.rows
    size = np.sqrt(np.diag(information))
    lower, upper = (bound[: len(size)] * size for bound in steps_within(problem, model))
    return minimise_within(information / np.outer(size, size), gradient / size, lower, upper) / size


def forced_joints(problem: WeakFormRows) -> list[tuple[Joint, float]]:
    """The joints at which unknown forces are a large part of the rows' noise, and their densities.

    Forces within the accuracy that laws are taken to have are no news.
    """
    joints, density = problem.scene.tree.joints, _densities(problem)
    shows = _shows(problem, density)
    return [(joint, float(own)) for joint, own, it in zip(joints, density, shows, strict=True) if it]


def exact_joints(problem: WeakFormRows) -> tuple[str, ...]:
    """The joints at which no unknown force shows, though one would that were as large as elsewhere.

    As large is: with the density, over the mean square of the joint's efforts, of the smallest that shows elsewhere.
    """
    density, efforts = _densities(problem), _mean_square_efforts(problem)
    shows = _shows(problem, density)
    if not np.any(shows):
        return ()
    least = np.min(density[shows] / np.maximum(efforts[shows], np.finfo(float).tiny))
    would = _shows(problem, least * efforts)
    return tuple(np.array(problem.scene.tree.joint_names)[would & ~shows].tolist())


def _densities(problem: WeakFormRows) -> Array:
    """(n,) of the unknown forces that are counted as noise."""
    return problem.unknown_force if problem.unknown_force.size else np.zeros(len(problem.scene.tree.joints))


def _shows(problem: WeakFormRows, density: Array) -> Flags:
    """(n,) whether forces of a `density` (n,) would be a large part of the rows' noise, and beyond inaccuracy."""
    if not np.any(density):
        return np.zeros(len(density), dtype=bool)
    physics, windows = problem.under.physics(problem.scene), problem.runs[0].weak.samples.windows
    # of each window's whitened rows, whose variance is 1
    part = np.mean([_parts(run, physics) for run in problem.runs], axis=0) * density
    within = LAW_ACCURACY**2 * _mean_square_efforts(problem) * windows.spacing
    return np.asarray((part > UNKNOWN_FORCE_VARIANCE_SHARE) & (density > within))


def _mean_square_efforts(problem: WeakFormRows) -> Array:
    """(n,)"""
    physics = problem.under.physics(problem.scene)
    return np.asarray(np.mean(np.concatenate([run.weak.mean_effort(physics) for run in problem.runs]) ** 2, axis=0))


def remarks(problem: WeakFormRows) -> tuple[str, ...]:
    """A sentence on the `forced_joints`, if any, with the sizes of the forces."""
    width = problem.runs[0].weak.samples.windows.width
    found = [
        f"of {rounded(float(np.sqrt(density / width)), 2)} {'N' if joint.prismatic else 'N m'} at {joint.name}"
        for joint, density in forced_joints(problem)
    ]
    return (f"unknown random forces act like white noise over {width:.2g} s, {listed(found)}",) if found else ()


def _parts(run: Run, physics: Physics) -> list[float]:
    """Σ of squared whitened rows of a window by a white force of unit density, for each joint."""
    return [
        sum(float(np.sum(seen**2)) for _, seen in whitened_parts(run.whiten, factor)) / run.shape[0]
        for factor in unknown_force_factors(run.weak, physics)
    ]


@dataclass(frozen=True)
class _Recording:
    """`rows` (R,), their `slopes` (R, n) by the unknowns, and the covariance (R, R) of their noise.

    And F (R, M) of each joint: a force of unit density adds F Fᵀ to the covariance.
    """

    rows: Array
    slopes: Array
    noise: SymmetricBand
    factors: list[sp.csr_matrix]

    @property
    def power(self) -> Array:
        """(n,) Σ of the squared rows that each joint's force enters."""
        return np.array([float(self.rows**2 @ (np.diff(factor.indptr) > 0)) for factor in self.factors])

    @property
    def size(self) -> Array:
        """(n,) expectation of `power` by a unit force alone."""
        return np.array([float((factor.data**2).sum()) for factor in self.factors])

    @cached_property
    def _shares(self) -> list[LowerEntries]:
        """Entries of each force's F Fᵀ on and below the diagonal."""
        return [lower_entries(factor @ factor.T) for factor in self.factors]

    def whitened(self, density: Array) -> "_Whitened":
        """The same, whitened with white forces of `density` (n,) as noise."""
        covariance = self.noise.copy()
        for d, share in zip(density, self._shares, strict=True):
            if d > 0.0:
                covariance.add_entries(d, share)
        whiten = Whitening.of(covariance)
        slopes = whiten(self.slopes) if self.slopes.shape[1] else self.slopes
        return _Whitened(whiten, whiten(self.rows), slopes, self.factors)


@dataclass(frozen=True)
class _Whitened:
    """Rows and slopes of a recording, whitened under some densities; `factors` are not."""

    whiten: Whitening
    rows: Array
    slopes: Array
    factors: list[sp.csr_matrix]

    def score(self, change: Array) -> tuple[Array, Array]:
        """(n,) derivative of the log likelihood by each density, ½ (zᵀFFᵀz − tr FFᵀ) whitened, and its information.

        At unknowns that differ by `change`.
        """
        white = self.rows + self.slopes @ change
        score, information = np.zeros(len(self.factors)), np.zeros(len(self.factors))
        for j, factor in enumerate(self.factors):
            for rows, seen in whitened_parts(self.whiten, factor):
                score[j] += 0.5 * float(np.sum((seen.T @ white[rows]) ** 2) - np.sum(seen**2))
                # forces of two parts share next to nothing
                information[j] += 0.5 * float(np.sum((seen.T @ seen) ** 2))
        return score, information
