"""Pushes of unknown time: candidate intervals, and the intervals about a candidate over which it is fitted."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.thresholds import PUSH_CENTRE_SHIFTS, PUSH_DURATION_RATIOS, PUSH_DURATIONS, PUSH_SPACING
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Push:
    """A pulse over [start, stop] s of the recording with index `run`, and the decrease of χ² by forces there."""

    run: int
    start: float
    stop: float
    gain: float

    def intervals(self) -> Iterator[tuple[float, float]]:
        """Start and stop, s, of nine intervals: the push's own, and shifted or resized ones."""
        duration = self.stop - self.start
        for center in PUSH_CENTRE_SHIFTS:
            for width in PUSH_DURATION_RATIOS:
                middle = 0.5 * (self.start + self.stop) + center * duration
                yield middle - 0.5 * width * duration, middle + 0.5 * width * duration


def candidate_intervals(begin: float, end: float) -> Iterator[tuple[float, float]]:
    """Start and duration, s, of the pulses that are tested in a recording from `begin` to `end` s."""
    for duration in PUSH_DURATIONS:
        for start in np.arange(begin, end - duration, PUSH_SPACING * duration):
            yield float(start), float(duration)


def push_over(effect: ExternalDisturbance, interval: tuple[float, float], recording: str, peak: Array) -> Effect:
    """The effect as a push of `peak` (3,) N over an interval, s, of the recording of that name."""
    x, y, z = (float(component) for component in peak)
    return effect.with_values({"x": x, "y": y, "z": z}).during(*interval, recording)


def search_once(known: list[Any], residual: Array, search: Any) -> tuple[list[Push], int]:
    """The strongest pushes of a residual and the number of tests, from `search()`; `known` caches the last result."""
    if not known or known[0] is not residual:
        known[:] = [residual, *search()]
    return known[1], known[2]
