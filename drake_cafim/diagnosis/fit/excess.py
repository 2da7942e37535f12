"""The excess of χ² over its expectation under noise, by place, and the intervals of time in which it is significant."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.thresholds import LOCATION_EXCESS_SHARE, LOCATION_P_VALUE, WINDOWS_PER_BLOCK
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.typing import Array

Place = tuple[str, str]
"""Kind and name."""
Interval = tuple[float, float]
"""Start and stop, s."""


@dataclass(frozen=True)
class Excess:
    """The excess χ², Σ max(Σ z² − n, 0), of each place, and the intervals of each recording in which it shows."""

    chi_square: dict[Place, float]
    shown: dict[tuple[Place, str], list[Interval]]

    @staticmethod
    def at(places: Iterable[Place]) -> "Excess":
        """No excess yet at `places`."""
        return Excess(dict.fromkeys(places, 0.0), {})

    def add(self, place: Place, squares: Array) -> None:
        """Adds max(Σ z² − n, 0) of the n `squares` z² of a place."""
        self.chi_square[place] += max(float(np.sum(squares)) - squares.size, 0.0)

    def show(self, place: Place, recording: str, intervals: Sequence[Interval]) -> None:
        """Adds intervals of a recording in which the place exceeds noise significantly."""
        if intervals:
            self.shown.setdefault((place, recording), []).extend(intervals)

    def locations(self, recordings: Sequence[str], condition: Callable[[Place], str]) -> tuple[Location, ...]:
        """The places that hold more than `LOCATION_EXCESS_SHARE` of the excess, strongest first, by recording.

        `condition` gives in words when the excess shows at a place. The share of a place is divided equally among the
        recordings in which it shows.
        """
        total = sum(self.chi_square.values())
        found = []
        for place in sorted(self.chi_square, key=lambda place: -self.chi_square[place]):
            share = self.chi_square[place] / total if total > 0.0 else 0.0
            shown = [name for name in dict.fromkeys(recordings) if (place, name) in self.shown]
            if not shown or share <= LOCATION_EXCESS_SHARE:
                continue
            words = condition(place)
            for name in shown:
                intervals = merge_intervals(self.shown[place, name])
                found.append(Location(*place, share / len(shown), intervals, name, words))
        return tuple(found)


def count_blocks(windows: int) -> int:
    """The number of blocks of `WINDOWS_PER_BLOCK` windows, at least one."""
    return max(windows // WINDOWS_PER_BLOCK, 1)


def significant_blocks(squares: Array, blocks: int) -> Iterator[slice]:
    """The blocks of `WINDOWS_PER_BLOCK` windows of a recording whose χ² is significant.

    `squares` (M,) or (M, r) are z². A block with f of them is significant where P(χ²_f > Σ z²) · `blocks` is below
    `LOCATION_P_VALUE`, `blocks` the number of tests in all. The last block is shifted back so that it is full.
    """
    for first in range(0, len(squares), WINDOWS_PER_BLOCK):
        part = slice(max(min(first, len(squares) - WINDOWS_PER_BLOCK), 0), first + WINDOWS_PER_BLOCK)
        if chi2.sf(float(np.sum(squares[part])), squares[part].size) * blocks < LOCATION_P_VALUE:
            yield part


def merge_intervals(intervals: list[Interval]) -> tuple[Interval, ...]:
    """The intervals in order, those that touch or overlap merged."""
    merged: list[Interval] = []
    for start, stop in sorted(intervals):
        if merged and start <= merged[-1][1] + 1e-9:
            merged[-1] = (merged[-1][0], max(stop, merged[-1][1]))
        else:
            merged.append((start, stop))
    return tuple(merged)
