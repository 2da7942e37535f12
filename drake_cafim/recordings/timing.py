"""Timing of a bag's topics: their rates, and their stamps against each other and against the recorder's clock."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.recordings.joining import JoinedTable
from drake_cafim.recordings.tracks import Series


@dataclass(frozen=True)
class TopicTiming:
    """Timing of one topic; `reference` is the first topic with joint positions, or else the first of all."""

    topic: str
    kind: str
    columns: tuple[str, ...]
    count: int
    first: float  # s, in the table's time
    last: float  # s
    median_step: float  # s
    clock_offset: float | None  # s, median of own stamp minus the recorder's; None: the recorder's is used
    reference: str
    shared: int  # samples whose stamp the reference has too
    apart: float  # s, median distance of the other samples to the reference's nearest stamp
    overlaps: bool  # whether the two cover a common stretch of time

    def __str__(self) -> str:
        text = f"{self.topic}: {self.kind}, {self.count} samples from {self.first:.6g} to {self.last:.6g} s"
        text += f", median step {self.median_step:.6g} s" if self.count > 1 else ""
        if self.clock_offset is None:
            text += "; stamped by the recorder"
        else:
            text += f"; stamps {self.clock_offset:+.6g} s from the recorder's clock"
        if self.topic == self.reference:
            return text
        text += f"; {self.shared} at a stamp of {self.reference}"
        text += f", the others {self.apart:.6g} s from the nearest" if self.shared < self.count else ""
        if not self.overlaps:
            text += "; the two do not overlap in time, `stamp: log` or `offset:` in topics: may correct this"
        return text


def timings(table: JoinedTable) -> tuple[TopicTiming, ...]:
    """The timing of each series of the table."""
    reference = next(
        (series for series in table.series if any(column.startswith("q.") for column in series.columns)),
        table.series[0],
    )
    return tuple(_timing(series, reference, table.start) for series in table.series)


def _timing(series: Series, reference: Series, start: int) -> TopicTiming:
    stamps, others = series.stamps, reference.stamps
    after = np.clip(np.searchsorted(others, stamps), 1, max(others.size - 1, 1))
    right = others[np.minimum(after, others.size - 1)]
    distance = np.minimum(np.abs(stamps - others[after - 1]), np.abs(right - stamps))
    apart = distance[distance > 0]
    return TopicTiming(
        topic=series.topic,
        kind=series.kind,
        columns=series.columns,
        count=int(stamps.size),
        first=float((stamps[0] - start) / 1e9),
        last=float((stamps[-1] - start) / 1e9),
        median_step=float(np.median(np.diff(stamps)) / 1e9) if stamps.size > 1 else 0.0,
        clock_offset=series.clock_offset,
        reference=reference.topic,
        shared=int(np.sum(distance == 0)),
        apart=float(np.median(apart) / 1e9) if apart.size else 0.0,
        overlaps=bool(stamps[0] <= others[-1] and others[0] <= stamps[-1]),
    )
