"""Local polynomial fits as sparse matrices: smoothing and differentiation on an uneven grid."""

from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.chebyshev import chebder, chebvander

from drake_cafim.typing import Array, Indices

CACHED_SAMPLES = 5_000
"""Largest number of samples whose matrices are cached, to limit memory."""
WEIGHTS_AT_ONCE = 200_000
"""Number of weights that are computed together, to limit memory."""

EVEN = 1e-9
"""Largest difference between sample intervals, over their median, at which the clock is even but for rounding."""


def local_polynomial(
    time: Array, reach: float, degree: int, derivative: int, at_least: int = 0, rows: Indices | None = None
) -> sp.csr_matrix:
    """(N, N) matrix whose product with samples is the `derivative`-th derivative of a local least-squares polynomial.

    A sample's fit uses the neighbours within `reach` s on both sides, but at least `at_least` (and enough for the
    degree) on each; near an end the same number, from the inside (Savitzky, Golay, Anal. Chem. 36(8), 1964). Cached
    for the next recording at the same `time` (N,) s. Only its `rows` (K,), (K, N), if they are given.
    """
    if len(time) > CACHED_SAMPLES:
        return _rows(time, reach, degree, derivative, at_least, np.arange(len(time)) if rows is None else rows)
    every = _local_polynomial(time.tobytes(), reach, degree, derivative, at_least)
    return every if rows is None or len(rows) == len(time) else sp.csr_matrix(every[rows])


@lru_cache(maxsize=64)
def _local_polynomial(at: bytes, reach: float, degree: int, derivative: int, at_least: int) -> sp.csr_matrix:
    time = np.frombuffer(at)
    return _rows(time, reach, degree, derivative, at_least, np.arange(len(time)))


def _rows(time: Array, reach: float, degree: int, derivative: int, at_least: int, rows: Indices) -> sp.csr_matrix:
    step = np.diff(time)
    half = max(int(np.floor(reach / np.median(step) + 1e-9)), at_least, (degree + 1) // 2)
    size = max(1, WEIGHTS_AT_ONCE // (2 * half + 1))
    computed, same = rows, np.arange(len(rows))
    if np.ptp(step) <= EVEN * np.median(step):
        # windows in which the sample has the same place have the same weights
        _, first, same = np.unique(rows - _first(rows, half, len(time)), return_index=True, return_inverse=True)
        computed = rows[first]
    parts = []
    for own in np.split(computed, np.arange(size, len(computed), size)):
        columns, x, width = _neighbours(time, half, own)
        wanted = _basis(_at_zero(x, columns, own), degree, derivative) / width**derivative
        parts.append(_weights(_basis(x, degree), wanted))
    weights = np.concatenate(parts)[same]
    columns = (_first(rows, half, len(time))[:, None] + np.arange(weights.shape[1])).astype(np.int32)
    return _sparse(weights, columns, len(time))


def track_polynomial(time: Array, reach: float, degree: int, ratio: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """(N, N) each: `from_q @ q + from_v @ v` is a local least-squares polynomial through positions and velocities.

    `ratio` s is the standard deviation of a position divided by that of a velocity; 0 leaves the velocities out.
    Cached for the next joint.
    """
    return _track_polynomial(time.tobytes(), reach, degree, ratio)


@lru_cache(maxsize=8)
def _track_polynomial(at: bytes, reach: float, degree: int, ratio: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    time = np.frombuffer(at)
    half = max(int(np.floor(reach / np.median(np.diff(time)) + 1e-9)), degree // 2 + 1)
    every = np.arange(len(time))
    columns, x, width = _neighbours(time, half, every)
    slopes = ratio * _basis(x, degree, 1) / width[..., None]
    weights = _weights(np.concatenate([_basis(x, degree), slopes], axis=1), _basis(_at_zero(x, columns, every), degree))
    count = columns.shape[1]
    return _sparse(weights[:, :count], columns, len(time)), _sparse(ratio * weights[:, count:], columns, len(time))


def _neighbours(time: Array, half: int, rows: Indices) -> tuple[Indices, Array, Array]:
    """The windows of the samples `rows` (R,): indices of their samples (R, c), their places, −1 … 1, and half widths
    (R, 1) s.
    """
    columns = _first(rows, half, len(time))[:, None] + np.arange(min(2 * half + 1, len(time)))
    begin, end = time[columns[:, :1]], time[columns[:, -1:]]
    width = 0.5 * (end - begin)
    return columns, (time[columns] - 0.5 * (begin + end)) / width, width


def _first(rows: Indices, half: int, samples: int) -> Indices:
    """(R,) the first samples of the windows of `rows` (R,)."""
    return np.asarray(np.clip(rows - half, 0, samples - min(2 * half + 1, samples)))


def _at_zero(x: Array, columns: Indices, rows: Indices) -> Array:
    """The place (R,) of each of the samples `rows` in its window, whose samples are at `x` (R, c)."""
    return np.asarray(x[np.arange(len(x)), rows - columns[:, 0]], dtype=float)


def _basis(x: Array, degree: int, derivative: int = 0) -> Array:
    """Chebyshev polynomials up to `degree` at `x` (...,), or their derivatives, (..., degree + 1).

    Their normal equations are well conditioned; those of monomials would lose digits.
    """
    return np.asarray(chebvander(x, degree - derivative) @ chebder(np.eye(degree + 1), derivative), dtype=float)


def _weights(basis: Array, wanted: Array) -> Array:
    """Weights (N, c) of the samples in the least-squares value `wanted` (N, k) · the coefficients of `basis`
    (N, c, k).
    """
    if basis.shape[1] < basis.shape[2]:
        return np.asarray((wanted[:, None] @ np.linalg.pinv(basis))[:, 0], dtype=float)
    normal = np.swapaxes(basis, 1, 2) @ basis
    try:
        solved = np.linalg.solve(normal, wanted[..., None])
    except np.linalg.LinAlgError:
        # samples on both sides of a long gap are nearly two points, too few: the solution of least norm is taken
        return np.asarray((wanted[:, None] @ np.linalg.pinv(basis))[:, 0], dtype=float)
    return np.asarray((basis @ solved)[..., 0], dtype=float)


def _sparse(weights: Array, columns: Indices, samples: int) -> sp.csr_matrix:
    """The sparse matrix (K, N) of N `samples` with `weights` (K, c) in the columns `columns` (K, c) of each row."""
    rows, count = columns.shape
    starts = np.arange(rows + 1, dtype=np.int32) * count
    return sp.csr_matrix((weights.ravel(), columns.ravel(), starts), shape=(rows, samples))
