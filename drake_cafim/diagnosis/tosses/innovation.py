"""What each sample says beyond the samples before it, the initial state of a flight being free.

A square-root information filter: the rows of one sample after the other are absorbed into a triangular factor of what
is known of the initial state, and what is orthogonal to it are innovations, independent and of unit variance (Bierman,
Factorization Methods for Discrete Sequential Estimation, 1977, ch. V). To first order no initial state moves them.

The triangle stays one: a Householder reflection of column j moves row j of it and the sample's six, and no other.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Flags

VAGUE = np.array([1.0] * 3 + [1.0] * 3 + [30.0] * 3 + [300.0] * 3)
"""Standard deviations of what is known of the initial state before any sample: m, rad, m/s, rad/s."""


@dataclass(frozen=True)
class Innovation:
    """The `reflections` (B, S, 12, 7) of B flights of S samples, as in `_absorbed`, and the last triangle (B, 12, 12).

    `spread` (B, S) is ln det of each sample's covariance given those before it, in units of its own noise.
    """

    reflections: Array
    triangle: Array
    spread: Array

    @classmethod
    def of(cls, rows: Array) -> "Innovation":
        """By the whitened slopes (B, S, 6, 12) of the samples in the initial states; zero rows say nothing."""
        triangle = np.broadcast_to(np.diag(1.0 / VAGUE), (len(rows), 12, 12)).copy()
        reflections, spread = _absorbed(np.array(rows, dtype=float, order="C"), triangle)
        return cls(reflections, triangle, spread)

    def replaced(self, which: Flags, other: "Innovation") -> "Innovation":
        """This one with `other` of the flights of `which` (B,)."""
        parts = [(getattr(self, k).copy(), getattr(other, k)) for k in ("reflections", "triangle", "spread")]
        for own, new in parts:
            own[which] = new
        return Innovation(*(own for own, _ in parts))

    def __call__(self, rows: Array) -> tuple[Array, Array]:
        """Innovations (B, S, 6, k) of whitened rows (B, S, 6, k), and what is left along the triangle, (B, 12, k)."""
        result = np.array(rows, dtype=float, order="C")
        carried = np.zeros((rows.shape[0], 12, rows.shape[3]))
        _reflected(self.reflections, result, carried)
        return result, carried


@compiled
def _absorbed(rows: Array, triangle: Array) -> tuple[Array, Array]:
    """Absorbs `rows` (B, S, 6, 12) into the triangles (B, 12, 12), in place; their reflections, and the spread (B, S).

    A reflection of column j is (1, v)(1, v)ᵀ τ taken off row j and the six: v (6,), then τ. As in LAPACK's dlarfg the
    triangle's diagonal changes its sign with each.
    """
    B, S = rows.shape[:2]
    reflections, spread = np.zeros((B, S, 12, 7)), np.zeros((B, S))
    for b in range(B):
        T = triangle[b]
        for s in range(S):
            A = rows[b, s]
            for j in range(12):
                one = reflections[b, s, j]
                square = 0.0
                for i in range(6):
                    square += A[i, j] * A[i, j]
                if square == 0.0:
                    continue
                before = T[j, j]
                T[j, j] = -np.copysign(np.sqrt(before * before + square), before)
                for i in range(6):
                    one[i] = A[i, j] / (before - T[j, j])
                one[6] = (T[j, j] - before) / T[j, j]
                spread[b, s] += 2.0 * np.log(np.abs(T[j, j] / before))
                _reflect(one, T[j, j + 1 :], A[:, j + 1 :])
    return reflections, spread


@compiled
def _reflected(reflections: Array, rows: Array, carried: Array) -> None:
    """Takes rows (B, S, 6, k), and what is `carried` (B, 12, k) from sample to sample, through the reflections."""
    for b in range(rows.shape[0]):
        for s in range(rows.shape[1]):
            for j in range(12):
                if reflections[b, s, j, 6] != 0.0:
                    _reflect(reflections[b, s, j], carried[b, j], rows[b, s])


@compiled
def _reflect(one: Array, row: Array, six: Array) -> None:
    """A reflection of a triangle's `row` (k,) and a sample's `six` (6, k), in place."""
    p, q, r, x, y, z, share = one
    for c in range(len(row)):
        # written out, so that columns are reckoned side by side
        along = row[c] + p * six[0, c] + q * six[1, c] + r * six[2, c]
        along = share * (along + x * six[3, c] + y * six[4, c] + z * six[5, c])
        row[c] -= along
        six[0, c] -= p * along
        six[1, c] -= q * along
        six[2, c] -= r * along
        six[3, c] -= x * along
        six[4, c] -= y * along
        six[5, c] -= z * along
