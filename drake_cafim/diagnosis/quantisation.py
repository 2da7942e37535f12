"""Rounding to a lattice: noise that is white only while a channel moves by more than a step from sample to sample."""

from collections.abc import Mapping

import numpy as np

from drake_cafim.diagnosis.coloured_noise import LONGEST, Memory
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

OFF = 0.01
"""Of a step, by which a value may lie off the lattice."""
STRIDE = 0.05
"""s between the values whose differences make up the way that a channel went; noise is averaged out in between."""


def quantum(values: Array) -> float | None:
    """The step of the lattice that `values` (N,) lie on; None where they lie on none."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3:
        return None
    apart = np.diff(levels)
    step = float(apart.min())
    # repeated additions leave levels that differ by rounding only
    if step < 1e-9 * float(np.abs(levels).max()):
        return None
    times = apart / step
    return step if float(np.abs(times - np.round(times)).max()) < OFF else None


def dwell(time: Array, values: Array, step: float) -> float:
    """Mean time, s, in which a channel goes one `step`."""
    stride = max(1, round(STRIDE / float(np.median(np.diff(time)))))
    count = len(values) // stride
    if count < 2:
        return 0.0
    means = values[: count * stride].reshape(count, stride).mean(axis=1)
    way = float(np.nansum(np.abs(np.diff(means))))
    return float(time[-1] - time[0]) * step / max(way, step)


def remembered(step: float, deviation: float) -> float:
    """The variance of the rounding error that lasts, where noise of `deviation` in all is partly white before rounding.

    The error is Σₖ (−1)ᵏ step/(πk) sin(2πk x/step); white noise of deviation w on x leaves exp(−2 (πk w/step)²) of
    each wave's mean (Widrow, Kollár, 2008, §19: dither).
    """
    white = max(deviation**2 - step**2 / 12.0, 0.0)
    waves = np.arange(1, 50)
    left = np.exp(-4.0 * np.pi**2 * waves**2 * white / step**2)
    return float(np.sum(step**2 / (2.0 * np.pi**2 * waves**2) * left))


def quantised_memories(recording: Recording, std: Mapping[str, float]) -> dict[str, Memory]:
    """The memory of each measured column of `recording` whose rounding lasts longer than a sample.

    The error of rounding a ramp that takes T for a step Δ has variance Δ²/12 and correlation 1 − 6τ/T + 6 (τ/T)²,
    which starts like exp(−τ/(T/6)) (Widrow, Kollár, Quantization Noise, 2008, §5).
    Of an error that stays longer than windows are wide these see its changes only, 2 Δ²/12 τ/(T/6) of its variance,
    and an error that never changes is a bias.
    """
    interval = float(np.median(np.diff(recording.time)))
    found: dict[str, Memory] = {}
    for column, deviation in std.items():
        if deviation == 0.0:
            continue
        values = recording.measured(column)
        step = quantum(values)
        if step is None:
            continue
        lasting = dwell(recording.time, values, step) / 6.0
        if lasting > interval:
            time = min(lasting, LONGEST)
            rounded = min(1.0, remembered(step, deviation) / deviation**2)
            found[column] = Memory(time, rounded * time / lasting, 1.0 - rounded)
    return found
