"""Local polynomial fits as sparse matrices: smoothing and differentiation on an uneven grid."""

from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.chebyshev import chebder, chebvander

from drake_cafim.typing import Array, Indices


def local_polynomial(time: Array, reach: float, degree: int, derivative: int, at_least: int = 0) -> sp.csr_matrix:
    """(N, N) matrix whose product with samples is the `derivative`-th derivative of a local least-squares polynomial.

    Each sample takes the neighbours within `reach` s on both sides, but at least `at_least` (and enough for the
    degree) on each; near an end as many, from the inside (Savitzky, Golay, Anal. Chem. 36(8), 1964). Kept for the
    next recording at the same `time` (N,) s.
    """
    return _local_polynomial(time.tobytes(), reach, degree, derivative, at_least)


@lru_cache(maxsize=64)
def _local_polynomial(at: bytes, reach: float, degree: int, derivative: int, at_least: int) -> sp.csr_matrix:
    time = np.frombuffer(at)
    half = max(int(np.floor(reach / np.median(np.diff(time)) + 1e-9)), at_least, (degree + 1) // 2)
    columns, x, width = _neighbours(time, half)
    weights = _weights(_basis(x, degree), _basis(_at_zero(x, columns), degree, derivative) / width**derivative)
    return _laid(weights, columns)


def track_polynomial(time: Array, reach: float, degree: int, ratio: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """(N, N) each: `from_q @ q + from_v @ v` is a local least-squares polynomial through positions and velocities.

    `ratio` s is the standard deviation of a position over that of a velocity; 0 leaves the velocities out. Kept for the
    next joint.
    """
    return _track_polynomial(time.tobytes(), reach, degree, ratio)


@lru_cache(maxsize=8)
def _track_polynomial(at: bytes, reach: float, degree: int, ratio: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    time = np.frombuffer(at)
    half = max(int(np.floor(reach / np.median(np.diff(time)) + 1e-9)), degree // 2 + 1)
    columns, x, width = _neighbours(time, half)
    slopes = ratio * _basis(x, degree, 1) / width[..., None]
    weights = _weights(np.concatenate([_basis(x, degree), slopes], axis=1), _basis(_at_zero(x, columns), degree))
    count = columns.shape[1]
    return _laid(weights[:, :count], columns), _laid(ratio * weights[:, count:], columns)


def _neighbours(time: Array, half: int) -> tuple[Indices, Array, Array]:
    """Which samples each one's window takes, (N, c), where in it they are, −1 … 1, and its half width (N, 1) s."""
    samples = len(time)
    count = min(2 * half + 1, samples)
    first = np.clip(np.arange(samples) - half, 0, samples - count)
    columns = first[:, None] + np.arange(count)
    begin, end = time[columns[:, :1]], time[columns[:, -1:]]
    width = 0.5 * (end - begin)
    return columns, (time[columns] - 0.5 * (begin + end)) / width, width


def _at_zero(x: Array, columns: Indices) -> Array:
    """Where each sample itself is in its window `x` (N, c), (N,)."""
    own = np.arange(len(x))
    return np.asarray(x[own, own - columns[:, 0]], dtype=float)


def _basis(x: Array, degree: int, derivative: int = 0) -> Array:
    """Chebyshev's polynomials up to `degree` at `x` (...,), or a derivative of theirs, (..., degree + 1).

    Least squares by their normal equations lose no digits, as those of powers would.
    """
    return np.asarray(chebvander(x, degree - derivative) @ chebder(np.eye(degree + 1), derivative), dtype=float)


def _weights(basis: Array, wanted: Array) -> Array:
    """(N, c) of samples in a fit by `basis` (N, c, k) of which `wanted` (N, k) are read."""
    if basis.shape[1] < basis.shape[2]:
        return np.asarray((wanted[:, None] @ np.linalg.pinv(basis))[:, 0], dtype=float)
    normal = np.swapaxes(basis, 1, 2) @ basis
    return np.asarray((basis @ np.linalg.solve(normal, wanted[..., None]))[..., 0], dtype=float)


def _laid(weights: Array, columns: Indices) -> sp.csr_matrix:
    """The (N, N) matrix of `weights` (N, c) on the samples `columns` (N, c)."""
    samples, count = columns.shape
    starts = np.arange(samples + 1) * count
    return sp.csr_matrix((weights.ravel(), columns.ravel(), starts), shape=(samples, samples))
