"""The covariance that forces make which are alike for a while: their correlation falls from one to zero, linearly."""

import numpy as np
import scipy.sparse as sp

from drake_cafim.typing import Array

INSTANTS_AT_ONCE = 2000
"""Instants whose correlations with all others are held in memory at a time."""


def lasting(by_instant: sp.csr_matrix, time: Array, reach: float) -> sp.csr_matrix:
    """B K Bᵀ (R, R) of rows `by_instant` B (R, N) of unit forces at N instants, K_ij = max(1 − |t_i − t_j|/`reach`, 0).

    `time` (N,) increases, s, as is `reach`. K has an entry for each two samples within reach of each other, gigabytes
    of a minute of samples, so that only a few of its rows exist at a time.
    """
    R, N = by_instant.shape
    total, columns = sp.csr_matrix((R, R)), sp.csc_matrix(by_instant)
    first, last = np.searchsorted(time, time - reach), np.searchsorted(time, time + reach, side="right")
    for begin in range(0, N, INSTANTS_AT_ONCE):
        own = np.arange(begin, min(begin + INSTANTS_AT_ONCE, N))
        counts = last[own] - first[own]
        starts = np.cumsum(counts) - counts
        others = np.arange(counts.sum()) + np.repeat(first[own] - starts, counts)
        alike = 1.0 - np.abs(time[others] - np.repeat(time[own], counts)) / reach
        K = sp.csr_matrix((alike, others, np.append(starts, counts.sum())), shape=(len(own), N))
        total = total + columns[:, own] @ (K @ by_instant.T)
    return sp.csr_matrix(total)
