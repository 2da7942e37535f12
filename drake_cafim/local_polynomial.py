"""Local polynomial fits as sparse matrices: smoothing and differentiation on an uneven grid."""

from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from drake_cafim.typing import Array


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
    samples = len(time)
    half = max(int(np.floor(reach / np.median(np.diff(time)) + 1e-9)), at_least, (degree + 1) // 2)
    count = min(2 * half + 1, samples)
    first = np.clip(np.arange(samples) - half, 0, samples - count)
    columns = first[:, None] + np.arange(count)
    offset = time[columns] - time[:, None]
    scale = np.abs(offset).max(axis=1, keepdims=True)
    powers = (offset / scale)[..., None] ** np.arange(degree + 1)
    # the fit's value at zero is its first coefficient, its d-th derivative d! times coefficient d
    weights = np.linalg.pinv(powers)[:, derivative, :]
    weights = weights * float(np.prod(np.arange(1, derivative + 1))) / scale**derivative
    rows = np.repeat(np.arange(samples), count)
    return sp.csr_matrix((weights.ravel(), (rows, columns.ravel())), shape=(samples, samples))


def track_polynomial(time: Array, reach: float, degree: int, ratio: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """(N, N) each: `from_q @ q + from_v @ v` is a local least-squares polynomial through positions and velocities.

    `ratio` s is the standard deviation of a position over that of a velocity; 0 leaves the velocities out.
    """
    samples = len(time)
    half = max(int(np.floor(reach / np.median(np.diff(time)) + 1e-9)), degree // 2 + 1)
    count = min(2 * half + 1, samples)
    first = np.clip(np.arange(samples) - half, 0, samples - count)
    columns = first[:, None] + np.arange(count)
    offset = time[columns] - time[:, None]
    scale = np.abs(offset).max(axis=1, keepdims=True)
    exponents = np.arange(degree + 1)
    x = (offset / scale)[..., None]
    powers = x**exponents
    slopes = exponents * x ** np.maximum(exponents - 1, 0) / scale[..., None]
    weights = np.linalg.pinv(np.concatenate([powers, ratio * slopes], axis=1))[:, 0, :]
    rows = np.repeat(np.arange(samples), count)

    def laid(values: Array) -> sp.csr_matrix:
        return sp.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=(samples, samples))

    return laid(weights[:, :count]), laid(ratio * weights[:, count:])
