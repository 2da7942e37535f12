"""Correction of samples for clock jitter: on an uneven clock, differences of samples contain motion, not only noise."""

import numpy as np

from drake_cafim.diagnosis.thresholds import CLOCK_SMOOTHING_REACH, EVEN_CLOCK_DEVIATION, LOST_CLOCK_DEVIATION
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array


def remove_clock_jitter(time: Array, values: Array) -> Array:
    """`values` (N,) or (N, k), sampled at `time` (N,) s, moved to the nearest instants of an even clock; NaN stays NaN.

    The local slope times the deviation of each instant is subtracted, which leaves the noise as it is. Returns the
    values unchanged where the clock is even already, or where the instants follow no even clock at all.
    """
    valid = np.flatnonzero(np.isfinite(values.reshape(len(time), -1)).all(axis=1))
    if len(valid) < 8:
        return values
    instants = time[valid]
    intervals = np.diff(instants)
    interval = float(np.mean(intervals[intervals < 1.5 * np.median(intervals)]))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(intervals / interval), 1.0))])
    deviation = instants - np.polyval(np.polyfit(index, instants, 1), index)
    step = float(instants[-1] - instants[0]) / index[-1]
    if not EVEN_CLOCK_DEVIATION * step < float(np.abs(deviation).max()) < LOST_CLOCK_DEVIATION * step:
        return values
    slope = local_polynomial(instants, CLOCK_SMOOTHING_REACH, 3, 1, at_least=4) @ values[valid]
    result = values.copy()
    result[valid] -= slope * deviation.reshape(-1, *[1] * (values.ndim - 1))
    return result
