"""What a channel would read on an even clock: on an uneven one, differences of its samples hold motion."""

import numpy as np

from drake_cafim.local_polynomial import local_polynomial
from drake_cafim.typing import Array

EVEN, LOST = 1e-3, 0.5
"""Of a sampling time: what instants may be off an even clock to be on it, and beyond which there is none."""
REACH = 0.012
"""s, on either side, from which the motion between a sample and its even instant is taken."""


def evened(time: Array, values: Array) -> Array:
    """`values` (N,) or (N, k) at `time` (N,) s, less the motion from the nearest even instant; NaN stays.

    The noise stays what it is. Where instants are on no even clock at all, the values are returned as they are.
    """
    there = np.flatnonzero(np.isfinite(values.reshape(len(time), -1)).all(axis=1))
    if len(there) < 8:
        return values
    instants = time[there]
    apart = np.diff(instants)
    usual = float(np.mean(apart[apart < 1.5 * np.median(apart)]))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(apart / usual), 1.0))])
    off = instants - np.polyval(np.polyfit(index, instants, 1), index)
    step = float(instants[-1] - instants[0]) / index[-1]
    if not EVEN * step < float(np.abs(off).max()) < LOST * step:
        return values
    slope = local_polynomial(instants, REACH, 3, 1, at_least=4) @ values[there]
    result = values.copy()
    result[there] -= slope * off.reshape(-1, *[1] * (values.ndim - 1))
    return result
