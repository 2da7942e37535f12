"""Joining of topics that have different stamps into one table, without interpolation.

The rows are all stamps that any topic has. Samples share a row when their stamps are equal to the nanosecond,
which is what a ROS header resolves; where a topic has no sample at a stamp, its columns hold NaN. With `join: t`
each sample of a topic takes over the nearest stamp of the other topics, if that is at most t seconds away, one sample
for each stamp; stamps are changed in no other way, and a note says so.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.topics import Topic, Topics
from drake_cafim.recordings.tracks import Series, Ticks
from drake_cafim.typing import Array

EXACT = 2**53  # ns; float64 holds all integers up to here, so that seconds made of them keep each nanosecond
BLOCK_ROWS = 131072


@dataclass(frozen=True)
class JoinedTable:
    """All series as rows of one table; columns are computed on request, so that few are in memory at once."""

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


def join(name: str, all_series: Sequence[Series], topics: Topics, notes: list[str]) -> JoinedTable:
    """The table of all series; a note for each change of stamps is appended to `notes`.

    Raises `InputError` when two topics give the same column.
    """
    _refuse_conflicts(name, all_series)
    all_series = _snap(all_series, topics, notes)
    ticks = np.unique(np.concatenate([series.stamps for series in all_series]))
    start = 0
    if ticks[-1] >= EXACT or ticks[0] <= -EXACT:
        start = int(ticks[0])
        notes.append(f"time: seconds since the first stamp, which is {start} ns")
    columns = dict.fromkeys(column for series in all_series for column in series.columns)
    return JoinedTable(ticks=ticks, start=start, series=tuple(all_series), columns=tuple(columns))


def _refuse_conflicts(name: str, all_series: Sequence[Series]) -> None:
    owner: dict[str, str] = {}
    for series in all_series:
        for column in series.columns:
            other = owner.setdefault(column, series.topic)
            if other != series.topic:
                raise InputError(
                    f"{name}: column {column} comes from the topics {other} and {series.topic}; say in topics: "
                    "which of them is read, or give one of them another name"
                )


def _snap(all_series: Sequence[Series], topics: Topics, notes: list[str]) -> list[Series]:
    """The series, those with `join:` at the stamps of the others where these are near enough."""

    def tolerance(series: Series) -> int:
        return round(topics.get(series.topic, Topic()).join * 1e9)

    anchors = [series.stamps for series in all_series if tolerance(series) == 0]
    if not anchors or len(anchors) == len(all_series):
        return list(all_series)
    anchor = np.unique(np.concatenate(anchors))
    result = []
    for series in all_series:
        limit = tolerance(series)
        if limit:
            stamps = snap_stamps(series.stamps, anchor, limit)
            moved = np.abs(stamps - series.stamps)
            notes.append(
                f"{series.topic}: {np.isin(stamps, anchor).sum()} of {stamps.size} samples are at a stamp of the other "
                f"topics, moved by at most {moved.max() * 1e-9:.6g} s as join: asks"
            )
            series = replace(series, stamps=stamps)
        result.append(series)
    return result


def snap_stamps(stamps: Ticks, anchor: Ticks, limit: int) -> Ticks:
    """`stamps` (n,) ns, each replaced by the nearest of `anchor` (m,) if that is at most `limit` ns away.

    Where several are nearest to the same anchor, only the closest of them is replaced, so that no stamp occurs twice.
    """
    after = np.clip(np.searchsorted(anchor, stamps), 1, max(anchor.size - 1, 1))
    left, right = anchor[after - 1], anchor[np.minimum(after, anchor.size - 1)]
    nearest = np.where(stamps - left <= right - stamps, left, right)
    distance = np.abs(nearest - stamps)
    order = np.lexsort((distance, nearest))
    first = np.concatenate([[True], np.diff(nearest[order]) > 0])
    wins = np.zeros(stamps.size, dtype=bool)
    wins[order[first]] = True
    return np.where(wins & (distance <= limit), nearest, stamps)
