"""The standard deviation of a channel's noise, estimated from its fourth differences where the scenario states none."""

from collections.abc import Mapping, Sequence, Set

import numpy as np

from drake_cafim.diagnosis.noise.clock import remove_clock_jitter
from drake_cafim.diagnosis.noise.coloured import Memory
from drake_cafim.diagnosis.noise.quantised import quantum
from drake_cafim.diagnosis.thresholds import NOISE_ESTIMATE_GAP
from drake_cafim.typing import Array

DIFFERENCES = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


def noise_std(pieces: Sequence[tuple[Array, Array]]) -> float:
    """Standard deviation of one sample of a channel, from its `pieces`: times (N,) s and values (N,), NaN ignored.

    From differences of order four, in which a smooth motion is negligible; robust, by the median absolute deviation
    (1.4826 makes it a normal standard deviation). Differences of quantised values take few distinct values, of which
    the median says little, and barely contain the rounding error of a slow motion: for these the root mean square is
    used, and at least the standard deviation of a rounding error, step/√12.
    """
    differences = np.concatenate([_differences(time, values) for time, values in pieces])
    step = max((quantum(values) or 0.0 for _, values in pieces), default=0.0)
    if step > 0.0:
        return max(float(np.sqrt(np.mean(differences**2))), step / float(np.sqrt(12.0)))
    return 1.4826 * float(np.median(np.abs(differences)))


def correct_for_memory(
    std: Mapping[str, float], memories: Mapping[str, Memory], estimated: Set[str], step: float
) -> dict[str, float]:
    """`std` by column, the `estimated` ones corrected for the correlation `memories` at the sampling time `step` s.

    With fourth differences d and the correlation matrix C of five samples, the factor is √(dᵀd / dᵀC d).
    """
    apart = np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
    wide = dict(std)
    for column in estimated & set(memories):
        seen = DIFFERENCES @ np.exp(-step * apart / memories[column].time) @ DIFFERENCES
        wide[column] *= float(np.sqrt(DIFFERENCES @ DIFFERENCES / seen))
    return wide


def _differences(time: Array, values: Array) -> Array:
    """Fourth differences, normalised so that white noise keeps its standard deviation, of neighbours without a gap."""
    valid = np.isfinite(values)
    time, values = time[valid], remove_clock_jitter(time[valid], values[valid])
    span = time[4:] - time[:-4]
    found = np.convolve(values, DIFFERENCES, mode="valid") / float(np.linalg.norm(DIFFERENCES))
    return np.asarray(found[span < NOISE_ESTIMATE_GAP * np.median(span)])
