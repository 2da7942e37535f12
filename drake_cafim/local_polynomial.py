"""Local polynomial fits as sparse matrices: smoothing and differentiation on an uneven grid."""

import numpy as np
import scipy.sparse as sp

from drake_cafim.typing import Array


def local_polynomial(time: Array, reach: float, degree: int, derivative: int, at_least: int = 0) -> sp.csr_matrix:
    """(N, N) matrix whose product with samples is the `derivative`-th derivative of a local least-squares polynomial.

    Each sample takes the neighbours within `reach` s on both sides, but at least `at_least` (and enough for the
    degree) on each; near an end as many, from the inside (Savitzky, Golay, Anal. Chem. 36(8), 1964).
    """
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
