"""Innovations of the samples of flights whose initial states are free, by a square-root information filter.

With J the whitened slopes of a sample in the initial state and R the triangular factor of the information RᵀR of the
samples before it, Householder reflections Q give

    Q [R; J] = [R₊; 0],      Q [z; r] = [z₊; e]:

the innovations e are independent, of unit variance, and to first order do not depend on the initial state (Bierman,
Factorization Methods for Discrete Sequential Estimation, 1977, ch. V). The initial state that fits best is changed by
−R⁻¹ z. R stays triangular, since the reflection of column j changes row j of R and the six rows of the sample only.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Flags

VAGUE = np.array([1.0] * 3 + [1.0] * 3 + [30.0] * 3 + [300.0] * 3)
"""Standard deviations of the prior of an initial state: m, rad, m/s, rad/s. So wide that it does not matter."""


@dataclass(frozen=True)
class Innovation:
    """The filter of B flights of S samples: `reflections` (B, S, 12, 7) as in `_absorb`, and the final R (B, 12, 12).

    `spread` (B, S) is ln det S of each sample's covariance S given the samples before it, in units of its noise.
    """

    reflections: Array
    triangle: Array
    spread: Array

    @classmethod
    def of(cls, rows: Array) -> "Innovation":
        """From the whitened slopes J (B, S, 6, 12) of the samples in the initial states; rows of zeros are ignored."""
        triangle = np.broadcast_to(np.diag(1.0 / VAGUE), (len(rows), 12, 12)).copy()
        reflections, spread = _absorb(np.array(rows, dtype=float, order="C"), triangle)
        return cls(reflections, triangle, spread)

    def replace_flights(self, which: Flags, other: "Innovation") -> "Innovation":
        """A copy whose flights of `which` (B,) are those of `other`, in order."""
        parts = [(getattr(self, k).copy(), getattr(other, k)) for k in ("reflections", "triangle", "spread")]
        for own, new in parts:
            own[which] = new
        return Innovation(*(own for own, _ in parts))

    def __call__(self, rows: Array) -> tuple[Array, Array]:
        """Innovations e (B, S, 6, k) of whitened rows r (B, S, 6, k), and the final z (B, 12, k)."""
        result = np.array(rows, dtype=float, order="C")
        misfit = np.zeros((rows.shape[0], 12, rows.shape[3]))
        _reflect_rows(self.reflections, result, misfit)
        return result, misfit


@compiled
def _absorb(rows: Array, triangle: Array) -> tuple[Array, Array]:
    """Updates the triangles (B, 12, 12) in place by `rows` (B, S, 6, 12); the reflections and the spread (B, S).

    The reflection of column j, I − τ (1, v)(1, v)ᵀ on row j and the sample's six rows, is stored as v (6,), then τ. As
    in LAPACK's dlarfg each one changes the sign of the diagonal entry, which avoids cancellation.
    """
    B, S = rows.shape[:2]
    reflections, spread = np.zeros((B, S, 12, 7)), np.zeros((B, S))
    for b in range(B):
        T = triangle[b]
        for s in range(S):
            A = rows[b, s]
            for j in range(12):
                reflection = reflections[b, s, j]
                square = 0.0
                for i in range(6):
                    square += A[i, j] * A[i, j]
                if square == 0.0:
                    continue
                before = T[j, j]
                T[j, j] = -np.copysign(np.sqrt(before * before + square), before)
                for i in range(6):
                    reflection[i] = A[i, j] / (before - T[j, j])
                reflection[6] = (T[j, j] - before) / T[j, j]
                spread[b, s] += 2.0 * np.log(np.abs(T[j, j] / before))
                _reflect(reflection, T[j, j + 1 :], A[:, j + 1 :])
    return reflections, spread


@compiled
def _reflect_rows(reflections: Array, rows: Array, misfit: Array) -> None:
    """Applies the reflections in place to rows r (B, S, 6, k), which become e, and to z `misfit` (B, 12, k)."""
    for b in range(rows.shape[0]):
        for s in range(rows.shape[1]):
            for j in range(12):
                if reflections[b, s, j, 6] != 0.0:
                    _reflect(reflections[b, s, j], misfit[b, j], rows[b, s])


@compiled
def _reflect(reflection: Array, row: Array, six: Array) -> None:
    """Applies a reflection in place to a triangle's `row` (k,) and a sample's `six` rows (6, k)."""
    p, q, r, x, y, z, share = reflection
    for c in range(len(row)):
        # unrolled, so that the compiler vectorises over the columns
        along = row[c] + p * six[0, c] + q * six[1, c] + r * six[2, c]
        along = share * (along + x * six[3, c] + y * six[4, c] + z * six[5, c])
        row[c] -= along
        six[0, c] -= p * along
        six[1, c] -= q * along
        six[2, c] -= r * along
        six[3, c] -= x * along
        six[4, c] -= y * along
        six[5, c] -= z * along
