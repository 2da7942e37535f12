"""Pushes of unknown time: where one may have been, and the times about it at which it is looked at."""

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
    """A pulse over [start, stop] s of the recording with this index, and the χ² that forces there gain."""

    run: int
    start: float
    stop: float
    gain: float

    def intervals(self) -> Iterator[tuple[float, float]]:
        """s, nine times from when until when: the push's own, and a little beside it."""
        duration = self.stop - self.start
        for center in PUSH_CENTRE_SHIFTS:
            for width in PUSH_DURATION_RATIOS:
                middle = 0.5 * (self.start + self.stop) + center * duration
                yield middle - 0.5 * width * duration, middle + 0.5 * width * duration


def tried_intervals(begin: float, end: float) -> Iterator[tuple[float, float]]:
    """Start and duration, s, of the pulses that are tried in a recording from `begin` to `end` s."""
    for duration in PUSH_DURATIONS:
        for start in np.arange(begin, end - duration, PUSH_SPACING * duration):
            yield float(start), float(duration)


def pushed(effect: ExternalDisturbance, interval: tuple[float, float], recording: str, peak: Array) -> Effect:
    """The effect as a push of `peak` (3,) N over an interval, s, of one recording."""
    x, y, z = (float(component) for component in peak)
    return effect.with_values({"x": x, "y": y, "z": z}).during(*interval, recording)


def found_once(known: list[Any], residual: Array, search: Any) -> tuple[list[Push], int]:
    """The strongest pushes of a residual and how many were tried, searched for once; `known` keeps the last answer."""
    if not known or known[0] is not residual:
        known[:] = [residual, *search()]
    return known[1], known[2]
