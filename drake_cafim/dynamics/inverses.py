"""Inverses of many small matrices at once, such as mass matrices along a motion."""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


def inverses(matrices: Array) -> Array:
    """The inverse (N, n, n) of each of `matrices` (N, n, n); inf or nan where a matrix is singular."""
    return np.asarray(_invert(np.array(matrices, dtype=float, order="C")), dtype=float)


@compiled
def _invert(left: Array) -> Array:
    """The same by Gauss-Jordan elimination with partial pivoting; `left` is overwritten."""
    N, n = left.shape[0], left.shape[1]
    result = np.zeros((N, n, n))
    for i in range(N):
        A, B = left[i], result[i]
        for c in range(n):
            B[c, c] = 1.0
        for c in range(n):
            pivot = c
            for r in range(c + 1, n):
                if abs(A[r, c]) > abs(A[pivot, c]):
                    pivot = r
            if pivot != c:
                for k in range(n):
                    A[c, k], A[pivot, k] = A[pivot, k], A[c, k]
                    B[c, k], B[pivot, k] = B[pivot, k], B[c, k]
            scale = 1.0 / A[c, c] if A[c, c] != 0.0 else np.inf
            for k in range(n):
                A[c, k] *= scale
                B[c, k] *= scale
            for r in range(n):
                factor = A[r, c]
                if r != c and factor != 0.0:
                    for k in range(n):
                        A[r, k] -= factor * A[c, k]
                        B[r, k] -= factor * B[c, k]
    return result
