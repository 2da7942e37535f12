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
from drake_cafim.diagnosis.thresholds import LASTING_FORCE_STDS, LAW_ACCURACY, UNKNOWN_FORCE_VARIANCE_SHARE
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
DISTINCT = 1e-6
"""Share of the information on lasting forces that white ones must leave, so that the two are not one."""
KINDS = 2
"""Kinds of unknown forces at a joint: white ones and lasting ones."""


def force_density(problem: WeakFormRows, model: Model, near: Array | None = None, lasting: bool = False) -> Array:
    """(n,) density of a white force at each joint, (N m)² s or N² s: the maximum likelihood given `model`.

    With `lasting`, (2n,) those of white forces and of ones that last (see `unknown_force_factors`), if any are there.
    They are looked for at joints where the likelihood rises with them, the white ones at their maximum, by more than
    it does by chance (Rao's score test).

    The steps begin at `near`, if that is given. Each density is a variance component of the rows, estimated by Fisher
    scoring and bounded below by zero (Harville, J. American Statistical Association 72(358), 1977, §4). The scene's
    unknowns follow each density to first order: those of `model` were fitted under another noise, and a mass that
    absorbed a part of one joint's force leaves, at the joints beside it, what would look like more of them.
    """
    physics = model.physics(problem.scene)
    starts = np.cumsum([run.rows for run in problem.runs])[:-1]
    recordings = []
    for run, slopes in zip(problem.runs, np.split(_slopes(problem, model), starts), strict=True):
        noise = row_covariance(run.weak, physics)
        factors = unknown_force_factors(run.weak, physics)
        recordings.append(_Recording(run.noisy_rows(physics).ravel(), run.whiten.unwhiten(slopes), noise, factors))
    n = len(problem.scene.tree.joints)
    # start from an upper bound: as if the rows held no noise of the channels
    most = np.sum([recording.power for recording in recordings], axis=0) / np.sum(
        [recording.size for recording in recordings], axis=0
    )
    if near is not None and len(near) > n and lasting:
        return _scored(problem, model, recordings, np.minimum(most, near))
    white = _scored(problem, model, recordings, most[:n] if near is None else np.minimum(most[:n], near[:n]))
    if not lasting:
        return white
    score, information = _scores(problem, model, recordings, np.append(white, np.zeros(n)))
    standing = np.array([_stands_out(*of) for of in zip(score.reshape(KINDS, n).T, information, strict=True)])
    if not np.any(standing):
        return white
    start = np.append(np.where(standing, 0.5, 1.0) * white, np.where(standing, 0.5 * white, 0.0))
    return _scored(problem, model, recordings, start)


def _scored(problem: WeakFormRows, model: Model, recordings: Sequence["_Recording"], density: Array) -> Array:
    """The densities of maximum likelihood, by scoring steps from `density` (c n,), c of each joint."""
    n = len(recordings[0].factors) // KINDS
    for _ in range(MOST_STEPS):
        before = density
        score, information = _scores(problem, model, recordings, density)
        kinds = len(density) // n
        each = zip(score.reshape(kinds, n).T, information, density.reshape(kinds, n).T, strict=True)
        # the maximum to second order, of the kinds at a joint together
        steps = [minimise_within(known, -slope, -now, np.full(kinds, np.inf)) for slope, known, now in each]
        density = density + np.array(steps).T.ravel()
        if np.all(np.abs(density - before) <= TOLERANCE * np.tile(before.reshape(kinds, n).sum(axis=0), kinds)):
            break
    return np.asarray(density, dtype=float)


def _stands_out(score: Array, information: Array) -> bool:
    """Whether the likelihood rises with a lasting force at a joint by more than it does by chance."""
    (a, b), (_, c) = information
    left = c - b * b / a
    # over windows without neighbours the two kinds are one
    return bool(left > DISTINCT * c and score[1] - score[0] * b / a > LASTING_FORCE_STDS * np.sqrt(left))


def _scores(
    problem: WeakFormRows, model: Model, recordings: Sequence["_Recording"], density: Array
) -> tuple[Array, Array]:
    """The sums over all recordings of `_Whitened.score`, with the unknowns that have their maximum at `density`."""
    whitened = [recording.whitened(density) for recording in recordings]
    change = _change_of_unknowns(problem, model, whitened)
    scores, informations = zip(*(own.score(change) for own in whitened), strict=True)
    return np.sum(scores, axis=0), np.sum(informations, axis=0)


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
    return [(joint, float(np.sum(own))) for joint, own, it in zip(joints, density.T, shows, strict=True) if it]


def exact_joints(problem: WeakFormRows) -> tuple[str, ...]:
    """The joints at which no unknown force shows, though one would that were as large as elsewhere.

    As large is: with the density, over the mean square of the joint's efforts, of the smallest that shows elsewhere.
    """
    density, efforts = _densities(problem), _mean_square_efforts(problem)
    shows = _shows(problem, density)
    if not np.any(shows):
        return ()
    least = np.min(np.sum(density, axis=0)[shows] / np.maximum(efforts[shows], np.finfo(float).tiny))
    would = _shows(problem, (least * efforts)[None])
    return tuple(np.array(problem.scene.tree.joint_names)[would & ~shows].tolist())


def _densities(problem: WeakFormRows) -> Array:
    """(kinds, n) of the unknown forces that are counted as noise, by their kind and joint."""
    n = len(problem.scene.tree.joints)
    return np.reshape(problem.unknown_force, (-1, n)) if problem.unknown_force.size else np.zeros((1, n))


def _shows(problem: WeakFormRows, density: Array) -> Flags:
    """(n,) whether forces of a `density` (kinds, n) would be a large part of the rows' noise, and beyond inaccuracy."""
    if not np.any(density):
        return np.zeros(density.shape[1], dtype=bool)
    physics, windows = problem.under.physics(problem.scene), problem.runs[0].weak.samples.windows
    # of each window's whitened rows, whose variance is 1
    part = np.sum(np.mean([_parts(run, physics, len(density)) for run in problem.runs], axis=0) * density, axis=0)
    within = LAW_ACCURACY**2 * _mean_square_efforts(problem) * windows.spacing
    return np.asarray((part > UNKNOWN_FORCE_VARIANCE_SHARE) & (np.sum(density, axis=0) > within))


def _mean_square_efforts(problem: WeakFormRows) -> Array:
    """(n,)"""
    physics = problem.under.physics(problem.scene)
    return np.asarray(np.mean(np.concatenate([run.weak.mean_effort(physics) for run in problem.runs]) ** 2, axis=0))


def forces_last(problem: WeakFormRows) -> bool:
    """Whether unknown forces that last for longer than a window are counted as noise."""
    return len(problem.unknown_force) > len(problem.scene.tree.joints)


def remarks(problem: WeakFormRows) -> tuple[str, ...]:
    """A sentence on the `forced_joints`, if any, with the sizes of the forces."""
    width = problem.runs[0].weak.samples.windows.width
    found = [
        f"of {rounded(float(np.sqrt(density / width)), 2)} {'N' if joint.prismatic else 'N m'} at {joint.name}"
        for joint, density in forced_joints(problem)
    ]
    acting = (
        f"last, with a mean over {width:.2g} s" if forces_last(problem) else f"act like white noise over {width:.2g} s,"
    )
    return (f"unknown random forces {acting} {listed(found)}",) if found else ()


def _parts(run: Run, physics: Physics, kinds: int) -> Array:
    """(kinds, n) Σ of squared whitened rows of a window by a force of unit density, by its kind and joint."""
    factors = unknown_force_factors(run.weak, physics)
    used = factors[: kinds * len(factors) // KINDS]
    parts = [sum(float(np.sum(seen**2)) for _, seen in whitened_parts(run.whiten, factor)) for factor in used]
    return np.reshape(parts, (kinds, -1)) / run.shape[0]


@dataclass(frozen=True)
class _Recording:
    """`rows` (R,), their `slopes` (R, n) by the unknowns, and the covariance (R, R) of their noise.

    And F (R, M) of each kind of force and joint: one of unit density adds F Fᵀ to the covariance.
    """

    rows: Array
    slopes: Array
    noise: SymmetricBand
    factors: list[sp.csr_matrix]

    @property
    def power(self) -> Array:
        """(2n,) Σ of the squared rows that each force enters."""
        return np.array([float(self.rows**2 @ (np.diff(factor.indptr) > 0)) for factor in self.factors])

    @property
    def size(self) -> Array:
        """(2n,) expectation of `power` by a unit force alone."""
        return np.array([float((factor.data**2).sum()) for factor in self.factors])

    @cached_property
    def _shares(self) -> list[LowerEntries]:
        """Entries of each force's F Fᵀ on and below the diagonal."""
        return [lower_entries(factor @ factor.T) for factor in self.factors]

    def whitened(self, density: Array) -> "_Whitened":
        """The same, whitened with forces of `density` (c n,) as noise, c kinds of them at each joint."""
        covariance = self.noise.copy()
        for d, share in zip(density, self._shares, strict=False):
            if d > 0.0:
                covariance.add_entries(d, share)
        whiten = Whitening.of(covariance)
        slopes = whiten(self.slopes) if self.slopes.shape[1] else self.slopes
        n = len(self.factors) // KINDS
        kinds = [self.factors[start : start + n] for start in range(0, len(density), n)]
        return _Whitened(whiten, whiten(self.rows), slopes, [list(at) for at in zip(*kinds, strict=True)])


@dataclass(frozen=True)
class _Whitened:
    """Rows and slopes of a recording, whitened under some densities; `factors`, of each joint, are not."""

    whiten: Whitening
    rows: Array
    slopes: Array
    factors: list[list[sp.csr_matrix]]

    def score(self, change: Array) -> tuple[Array, Array]:
        """(c n,) derivative of the log likelihood by each density, ½ (zᵀFFᵀz − tr FFᵀ) whitened, at changed unknowns.

        And the information (n, c, c) on the c densities of each joint.
        """
        white = self.rows + self.slopes @ change
        n, c = len(self.factors), len(self.factors[0])
        score, information = np.zeros((c, n)), np.zeros((n, c, c))
        for j, kinds in enumerate(self.factors):
            for parts in zip(*(whitened_parts(self.whiten, factor) for factor in kinds), strict=True):
                for k, (rows, seen) in enumerate(parts):
                    score[k, j] += 0.5 * float(np.sum((seen.T @ white[rows]) ** 2) - np.sum(seen**2))
                    # forces of two parts share next to nothing
                    for m, (_, other) in enumerate(parts):
                        both = min(len(seen), len(other))
                        information[j, k, m] += 0.5 * float(np.sum((seen[:both].T @ other[:both]) ** 2))
        return score.ravel(), information
