"""One table of topics that have stamps of their own, with no sample made up.

Rows are all stamps that any topic has. Samples stand in one row when their stamps are equal to the nanosecond,
which is what a ROS header resolves; where a topic has no sample at a stamp, its columns hold NaN. With `join: t`
a topic's samples take over the stamp of the others that is nearest, if it is at most t seconds away, one sample
a stamp; that is the only way in which a stamp is ever changed, and it is noted.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.topics import Topic, Topics
from drake_cafim.recordings.tracks import Series, Ticks
from drake_cafim.typing import Array

EXACT = 2**53  # ns; up to here float64 seconds resolve each nanosecond
BLOCK_ROWS = 131072


@dataclass(frozen=True)
class Joined:
    """The rows of all series; columns are made when asked for, so that few need to be held at once."""

    ticks: Ticks  # (N,) ns, strictly increasing
    start: int  # ns that are taken off before ticks become seconds
    series: tuple[Series, ...]
    columns: tuple[str, ...]

    @property
    def time(self) -> Array:
        """(N,) s; exact to the nanosecond."""
        return (self.ticks - self.start) / 1e9

    def block(self, first: int, last: int) -> dict[str, Array]:
        """The columns of rows first <= i < last, NaN where a topic has no sample."""
        ticks = self.ticks[first:last]
        block = {column: np.full(ticks.size, np.nan) for column in self.columns}
        for series in self.series:
            i, j = np.searchsorted(series.stamps, [ticks[0], ticks[-1] + 1]) if ticks.size else (0, 0)
            rows = np.searchsorted(ticks, series.stamps[i:j])
            for column, values in zip(series.columns, series.at(int(i), int(j)).T, strict=True):
                block[column][rows] = values
        return block

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[dict[str, Array]]:
        """All columns, `time` first, in pieces of `rows` rows."""
        time = self.time
        for first in range(0, self.ticks.size, rows):
            yield {"time": time[first : first + rows], **self.block(first, first + rows)}

    def table(self) -> dict[str, Array]:
        """All columns whole, `time` first."""
        return {"time": self.time, **self.block(0, self.ticks.size)}


def joined(name: str, series: Sequence[Series], topics: Topics, notes: list[str]) -> Joined:
    """The table of all series; what was done to stamps is said in `notes`.

    Raises `InputError` when two topics give the same column.
    """
    _refuse_conflicts(name, series)
    series = _snapped(series, topics, notes)
    ticks = np.unique(np.concatenate([one.stamps for one in series]))
    start = 0
    if ticks[-1] >= EXACT or ticks[0] <= -EXACT:
        start = int(ticks[0])
        notes.append(f"time: seconds since the first stamp, which is {start} ns")
    columns = dict.fromkeys(column for one in series for column in one.columns)
    return Joined(ticks=ticks, start=start, series=tuple(series), columns=tuple(columns))


def _refuse_conflicts(name: str, series: Sequence[Series]) -> None:
    owner: dict[str, str] = {}
    for one in series:
        for column in one.columns:
            other = owner.setdefault(column, one.topic)
            if other != one.topic:
                raise InputError(
                    f"{name}: column {column} comes from the topics {other} and {one.topic}; say in topics: "
                    "which of them is read, or give one of them another name"
                )


def _snapped(series: Sequence[Series], topics: Topics, notes: list[str]) -> list[Series]:
    def tolerance(one: Series) -> int:
        return round(topics.get(one.topic, Topic()).join * 1e9)

    anchors = [one.stamps for one in series if tolerance(one) == 0]
    if not anchors or len(anchors) == len(series):
        return list(series)
    anchor = np.unique(np.concatenate(anchors))
    result = []
    for one in series:
        limit = tolerance(one)
        if limit:
            stamps = snapped(one.stamps, anchor, limit)
            moved = np.abs(stamps - one.stamps)
            notes.append(
                f"{one.topic}: {np.isin(stamps, anchor).sum()} of {stamps.size} samples stand at a stamp of the other "
                f"topics, moved by at most {moved.max() * 1e-9:.6g} s as join: asks"
            )
            one = replace(one, stamps=stamps)
        result.append(one)
    return result


def snapped(stamps: Ticks, anchor: Ticks, limit: int) -> Ticks:
    """`stamps` (n,), each replaced by the nearest of `anchor` within `limit`; an anchor takes its nearest only."""
    after = np.clip(np.searchsorted(anchor, stamps), 1, max(anchor.size - 1, 1))
    left, right = anchor[after - 1], anchor[np.minimum(after, anchor.size - 1)]
    nearest = np.where(stamps - left <= right - stamps, left, right)
    distance = np.abs(nearest - stamps)
    order = np.lexsort((distance, nearest))
    first = np.concatenate([[True], np.diff(nearest[order]) > 0])
    wins = np.zeros(stamps.size, dtype=bool)
    wins[order[first]] = True
    return np.where(wins & (distance <= limit), nearest, stamps)
