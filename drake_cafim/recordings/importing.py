"""Description of a file's contents and conversion of the file: the work of `cafim import`."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_cafim.output import replacing
from drake_cafim.recordings.checks import describe_gaps, describe_missing
from drake_cafim.recordings.files import check_path, check_writable, read, write
from drake_cafim.recordings.gathering import LogContents, SkippedTopic, gather, reader_of
from drake_cafim.recordings.parquet import write_blocks
from drake_cafim.recordings.recording import is_signal
from drake_cafim.recordings.resampling import resample
from drake_cafim.recordings.timing import TopicTiming, timings
from drake_cafim.recordings.topics import Topics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Description:
    """The contents of a file: samples, columns, topics, and what was left out."""

    path: str
    samples: int  # rows of the table
    start: float  # s
    end: float  # s
    median_step: float  # s
    columns: tuple[str, ...]  # signals, in the table's order
    other_columns: tuple[str, ...]  # the others, which nothing uses
    topics: tuple[TopicTiming, ...]  # of a bag or log: those that were read
    left_alone: tuple[SkippedTopic, ...]  # of a bag or log: those that were not
    notes: tuple[str, ...]  # defects, and what was left out because of them

    def as_dict(self) -> dict[str, Any]:
        """The fields as a dictionary of lists, strings and numbers, for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        step = f", median step {self.median_step:.6g} s" if self.samples > 1 else ""
        lines = [f"{self.path}: {self.samples} samples from {self.start:.6g} to {self.end:.6g} s{step}"]
        lines += [f"  columns: {', '.join(self.columns) or 'none'}"]
        lines += [f"  other columns, left alone: {', '.join(self.other_columns)}"] if self.other_columns else []
        lines += [f"  {topic}" for topic in self.topics]
        # Every topic that is left alone has its note already.
        return "\n".join(lines + [f"  note: {note}" for note in self.notes])


def describe(path: str | Path, topics: Topics | None = None) -> Description:
    """The file's columns, its topics with their rates and clock offsets, and its defects.

    A bag or log is read once in bounded memory. Raises `InputError` as `read` does.
    """
    return _import(path, None, topics or {})


def convert(
    path: str | Path, out: str | Path, topics: Topics | None = None, *, period: float | None = None
) -> Description:
    """Write the recording in `path` to `out` (.parquet, .csv, .mcap), whole or not at all.

    A bag or log is written to Parquet row group by row group: memory holds its stamps and one row group,
    whatever its length. The bytes are those of `write(read(path, topics), out)`. With a `period` (s) the recording is
    first resampled, in memory. Raises `InputError` as `read` does, and for a suffix that cannot be written.
    """
    check_writable(Path(out))
    return _import(path, Path(out), topics or {}, period)


def _import(path: str | Path, out: Path | None, topics: Topics, period: float | None = None) -> Description:
    file = Path(path)
    check_path(file)
    if period is not None or reader_of(file) is None or (out is not None and out.suffix.lower() != ".parquet"):
        recording = read(path, topics)
        if period is not None:
            recording = resample(recording, period)
        if out is not None:
            write(recording, out)
        return _make_description(str(path), recording.time, tuple(recording.columns), recording.notes)
    gathered = gather(file, topics)
    notes = _write_streamed(gathered, out)
    table = gathered.table
    found = _make_description(str(path), table.time, table.columns, (*gathered.notes, *notes))
    return Description(**(found.__dict__ | {"topics": timings(table), "left_alone": gathered.left_alone}))


def _make_description(path: str, time: Array, columns: tuple[str, ...], notes: tuple[str, ...]) -> Description:
    return Description(
        path=path,
        samples=int(time.size),
        start=float(time[0]),
        end=float(time[-1]),
        median_step=float(np.median(np.diff(time))) if time.size > 1 else 0.0,
        columns=tuple(column for column in columns if is_signal(column)),
        other_columns=tuple(column for column in columns if not is_signal(column)),
        topics=(),
        left_alone=(),
        notes=notes,
    )


def _write_streamed(gathered: LogContents, out: Path | None) -> tuple[str, ...]:
    """Write the table block by block, and return the notes that `read` would make about its columns."""
    table = gathered.table
    time = table.time
    gone = {column: np.zeros(time.size, dtype=bool) for column in table.columns}

    def checked_blocks() -> Iterator[dict[str, Array]]:
        first = 0
        for block in table.blocks():
            last = first + block["time"].size
            for column, mask in gone.items():
                mask[first:last] = ~np.isfinite(block[column])
                block[column][mask[first:last]] = np.nan
            first = last
            yield block

    if out is None:
        for _ in checked_blocks():  # only for the notes
            pass
    else:
        with replacing(out) as temporary:
            write_blocks(checked_blocks(), temporary)
    sentences = [note for column, mask in gone.items() for note in describe_missing(column, time, mask)]
    return (*sentences, *describe_gaps(time))
