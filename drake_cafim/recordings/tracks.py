"""Buffers for the samples of a topic while a bag is read, with the values on disk: a long bag needs little memory."""

import mmap
import tempfile
from array import array
from dataclasses import dataclass

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.messages import Sample
from drake_cafim.recordings.topics import Topic
from drake_cafim.typing import Array

Ticks = np.ndarray[tuple[int, ...], np.dtype[np.int64]]  # ns


@dataclass(frozen=True)
class Series:
    """The samples of one topic that have the same columns, in the order of their stamps."""

    topic: str
    kind: str  # the message's type
    columns: tuple[str, ...]
    stamps: Ticks  # (n,) ns, strictly increasing
    rows: Ticks  # (n,) the row of `values` that belongs to each stamp
    values: Array  # (m, k), m >= n; lies in `disk`
    disk: mmap.mmap
    clock_offset: float | None  # s, median of own stamp minus recorder's; None where the recorder's is used

    def at(self, first: int, last: int) -> Array:
        """The values of samples first <= i < last, (last - first, k)."""
        taken = self.values[self.rows[first:last]]
        self.disk.madvise(mmap.MADV_DONTNEED)  # else the whole file stays in memory once it has been read
        return taken


class Track:
    """Collects the samples of one topic that have the same columns."""

    def __init__(self, topic: str, kind: str, columns: tuple[str, ...], how: Topic) -> None:
        self.topic, self.kind, self.columns, self.how = topic, kind, columns, how
        self._stamps, self._logs = array("q"), array("q")
        self._stamped = True
        self._file = tempfile.TemporaryFile()  # noqa: SIM115, closed by close()

    def __len__(self) -> int:
        return len(self._logs)

    def add(self, sample: Sample, log: int) -> None:
        """Store one sample; `log` is the recorder's stamp in ns."""
        self._stamped = self._stamped and sample.stamp is not None
        self._stamps.append(sample.stamp if sample.stamp is not None else 0)
        self._logs.append(log)
        self._file.write(sample.values.tobytes())

    def close(self) -> None:
        """Close the file; arrays that were mapped from it stay valid."""
        self._file.close()

    def series(self, name: str, notes: list[str]) -> Series:
        """All samples in the order of their stamps; repeated stamps are left out and counted in `notes`.

        Raises `InputError` when the stamps decrease.
        """
        logs = np.frombuffer(self._logs, dtype=np.int64)
        # The file's order may differ from that of arrival; only what decreases in the order of arrival is an error.
        rows = np.argsort(logs, kind="stable")
        stamps, offset = self._clock(logs, notes)
        stamps = stamps[rows] + round(self.how.offset * 1e9)
        back = np.flatnonzero(np.diff(stamps) < 0)
        if back.size:
            i = back[0]
            raise InputError(
                f"{name}: topic {self.topic}: the stamps decrease from {stamps[i]} to {stamps[i + 1]} ns at message "
                f"{i + 2} of {stamps.size}, expected them to increase"
            )
        fresh = np.concatenate([[True], np.diff(stamps) > 0])
        if not fresh.all():
            notes.append(f"{self.topic}: {np.sum(~fresh)} messages that repeat a stamp, left out")
        values, disk = self._mapped()
        return Series(
            topic=self.topic,
            kind=self.kind,
            columns=self.columns,
            stamps=stamps[fresh],
            rows=rows[fresh],
            values=values,
            disk=disk,
            clock_offset=offset,
        )

    def _clock(self, logs: Ticks, notes: list[str]) -> tuple[Ticks, float | None]:
        """The stamps to use (n,) ns, the messages' own or the recorder's, and the median difference of the two, s."""
        own = np.frombuffer(self._stamps, dtype=np.int64)
        if not self._stamped or self.how.stamp == "log":
            return logs, None
        if own.size > 1 and not own.any():
            notes.append(f"{self.topic}: all stamps are zero, the recorder's are used")
            return logs, None
        return own, float(np.median(own - logs)) * 1e-9

    def _mapped(self) -> tuple[Array, mmap.mmap]:
        self._file.flush()
        disk = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        return np.frombuffer(disk, dtype=np.float64).reshape(len(self), len(self.columns)), disk
