"""Forces at the joints that nobody knows, as noise: how strong, from what a model leaves."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import UNKNOWN_FORCE_VARIANCE_SHARE
from drake_cafim.diagnosis.whitening.covariance import Whitening, unknown_force_factors, whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.numerics.rounding import rounded
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

TURNS, SETTLED = 12, 0.02
"""Steps at most, and the part of a density that ends them."""


def likeliest(problem: WeakFormRows, model: Model) -> Array:
    """(n,) density of a white force at each joint, (N m)² s or N² s, under which what `model` leaves is likeliest.

    Each is a variance component of the rows: Fisher scoring, kept from falling below zero (Harville, J. American
    Statistical Association 72(358), 1977, §4).
    """
    physics = model.physics(problem.scene)
    recordings = []
    for run in problem.runs:
        noise = whitening(run.weak, physics)[0].covariance
        factors = unknown_force_factors(run.weak, physics)
        recordings.append(_Recording(run.weak.residual(physics).ravel(), noise, factors))
    # all that a joint's rows hold, as if none of it were the channels' noise
    density = np.sum([one.power for one in recordings], axis=0) / np.sum([one.size for one in recordings], axis=0)
    for _ in range(TURNS):
        before = density
        score, information = np.sum([one.score(density) for one in recordings], axis=0)
        density = np.maximum(density + score / information, 0.0)
        if np.all(np.abs(density - before) <= SETTLED * before):
            break
    return np.asarray(density, dtype=float)


def remarks(problem: WeakFormRows) -> tuple[str, ...]:
    """The joints at which forces that nobody knows make up a good part of the noise, and how large these are."""
    physics, windows = problem.under.physics(problem.scene), problem.runs[0].weak.samples.windows
    # of each window's whitened rows, whose variance is 1
    part = np.mean([_parts(run, physics) for run in problem.runs], axis=0) * problem.unknown_force
    found = []
    for joint, share, density in zip(problem.scene.tree.joints, part, problem.unknown_force, strict=True):
        if share > UNKNOWN_FORCE_VARIANCE_SHARE:
            size = f"{rounded(float(np.sqrt(density / windows.width)), 2)} {'N' if joint.prismatic else 'N m'}"
            found.append(
                f"forces that nobody knows shake {joint.name}, as white noise of {size} over {windows.width:.2g} s"
            )
    return tuple(found)


def _parts(run: Run, physics: Physics) -> list[float]:
    """What forces of unit density add to the squares of a window's whitened rows, by joint."""
    return [
        float(np.sum(run.whiten(one.toarray()) ** 2)) / run.shape[0] for one in unknown_force_factors(run.weak, physics)
    ]


@dataclass(frozen=True)
class _Recording:
    """`rows` (R,), the covariance of their noise, and that of a unit force at each joint as F Fᵀ, F (R, M)."""

    rows: Array
    noise: sp.csr_matrix
    factors: list[sp.csr_matrix]

    @property
    def power(self) -> Array:
        """(n,) Σ of the squared rows that each joint's force is in."""
        return np.array([float(self.rows**2 @ (np.diff(one.indptr) > 0)) for one in self.factors])

    @property
    def size(self) -> Array:
        """(n,) what a unit force makes of `power`."""
        return np.array([float((one.data**2).sum()) for one in self.factors])

    def score(self, density: Array) -> tuple[Array, Array]:
        """(n,) slope of the log likelihood by each density, and its expected curvature."""
        whiten = Whitening.of(self.noise + sum(d * one @ one.T for d, one in zip(density, self.factors, strict=True)))
        white = whiten(self.rows)
        score, information = np.zeros(len(density)), np.zeros(len(density))
        for j, one in enumerate(self.factors):
            seen = whiten(one.toarray())
            score[j] = 0.5 * float(np.sum((seen.T @ white) ** 2) - np.sum(seen**2))
            information[j] = 0.5 * float(np.sum((seen.T @ seen) ** 2))
        return score, information
