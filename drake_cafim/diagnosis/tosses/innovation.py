"""What each sample says beyond the samples before it, the initial state of a flight being free.

A square-root information filter: the rows of one sample after the other are absorbed into a triangular factor of what
is known of the initial state, and what is orthogonal to it are innovations, independent and of unit variance (Bierman,
Factorization Methods for Discrete Sequential Estimation, 1977, ch. V). To first order no initial state moves them.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

VAGUE = np.array([1.0] * 3 + [1.0] * 3 + [30.0] * 3 + [300.0] * 3)
"""Standard deviations of what is known of the initial state before any sample: m, rad, m/s, rad/s."""


@dataclass(frozen=True)
class Innovation:
    """The orthogonal factors (S, B, 18, 18) of B flights of S samples, and the last triangle (B, 12, 12).

    `spread` (B, S) is ln det of each sample's covariance given those before it, in units of its own noise.
    """

    factors: Array
    triangle: Array
    spread: Array

    @classmethod
    def of(cls, rows: Array) -> "Innovation":
        """By the whitened slopes (B, S, 6, 12) of the samples in the initial states; zero rows say nothing."""
        B, S = rows.shape[:2]
        triangle = np.broadcast_to(np.diag(1.0 / VAGUE), (B, 12, 12)).copy()
        factors, spread = np.empty((S, B, 18, 18)), np.empty((B, S))
        known = _log_determinant(triangle)
        for s in range(S):
            Q, R = np.linalg.qr(np.concatenate([triangle, rows[:, s]], axis=1), mode="complete")
            factors[s] = np.swapaxes(Q, 1, 2)
            triangle = R[:, :12]
            before, known = known, _log_determinant(triangle)
            spread[:, s] = 2.0 * (known - before)
        return cls(factors, triangle, spread)

    def __call__(self, rows: Array) -> tuple[Array, Array]:
        """Innovations (B, S, 6, k) of whitened rows (B, S, 6, k), and what is left along the triangle, (B, 12, k)."""
        result = np.empty_like(rows)
        carried = np.zeros((rows.shape[0], 12, rows.shape[3]))
        for s, factor in enumerate(self.factors):
            both = factor @ np.concatenate([carried, rows[:, s]], axis=1)
            carried, result[:, s] = both[:, :12], both[:, 12:]
        return result, carried


def _log_determinant(triangle: Array) -> Array:
    return np.asarray(np.sum(np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2))), axis=1), dtype=float)
