"""The rows of a file of any format in pieces, so that a long one is never in memory whole."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from drake_cafim.errors import InputError
from drake_cafim.recordings.checks import clean
from drake_cafim.recordings.columns import as_numbers, numeric_columns
from drake_cafim.recordings.csv import MISSING, NAMELESS, csv_header
from drake_cafim.recordings.files import check_path, read
from drake_cafim.recordings.gathering import LogContents, gather, reader_of
from drake_cafim.recordings.limits import check_size
from drake_cafim.recordings.parquet import DAMAGED
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.timing import timings
from drake_cafim.recordings.topics import Topics, check_topics, rename_columns
from drake_cafim.typing import Array

PIECE_ROWS = 65536
"""Rows of a piece."""
SAMPLED_BYTES = 65536
"""bytes of a CSV file from which the length of its lines is estimated."""


class Pieces(ABC):
    """One file's rows, as `read` gives them but for the checks of `clean`; `notes` are of what was left alone."""

    name: str
    notes: tuple[str, ...]

    @property
    @abstractmethod
    def rows(self) -> int:
        """The number of rows; of a CSV file about that."""

    @property
    @abstractmethod
    def time(self) -> Array:
        """(N,) s, every row's stamp."""

    @abstractmethod
    def blocks(self) -> Iterator[Mapping[str, Array]]:
        """All numeric columns under the names of the recording, some rows at a time, in order."""

    @abstractmethod
    def whole(self) -> Recording:
        """The recording as `read` gives it."""


def pieces_of(path: str | Path, topics: Topics | None = None, name: str = "") -> Pieces:
    """The pieces of the file at `path`, whose recording has that path as its name, or else `name`.

    All else is as `read` has it.
    """
    file, topics, name = Path(path), topics or {}, name or str(path)
    check_path(file)
    if reader_of(file) is not None:
        return LogPieces(name, gather(file, topics))
    check_topics(topics, str(path))
    suffix = file.suffix.lower()
    if suffix == ".parquet":
        with _parquet(file) as table:
            names, notes = numeric_columns(str(path), table.schema_arrow)
            rows = max(table.metadata.num_rows, 0)
            check_size(file, 8 * rows * len(names))
        return ParquetPieces(name, tuple(notes), file, topics, names, rows)
    if suffix == ".csv":
        return CsvPieces(name, file, topics)
    return TablePieces(replace(read(path, topics), name=name))


@dataclass
class TablePieces(Pieces):
    """A recording that is in memory already."""

    recording: Recording

    def __post_init__(self) -> None:
        self.name, self.notes = self.recording.name, self.recording.notes

    @property
    def rows(self) -> int:
        return len(self.recording)

    @property
    def time(self) -> Array:
        return self.recording.time

    def blocks(self) -> Iterator[Mapping[str, Array]]:
        yield {"time": self.recording.time, **self.recording.columns}

    def whole(self) -> Recording:
        return self.recording


@dataclass
class LogPieces(Pieces):
    """A bag or log, whose samples are on disk once it has been read."""

    name: str
    contents: LogContents

    def __post_init__(self) -> None:
        table = self.contents.table
        stamps = [str(timing) for timing in timings(table)] if len(table.series) > 1 else []
        self.notes = (*self.contents.notes, *stamps)

    @property
    def rows(self) -> int:
        return int(self.contents.table.ticks.size)

    @property
    def time(self) -> Array:
        return self.contents.table.time

    def blocks(self) -> Iterator[Mapping[str, Array]]:
        yield from self.contents.table.blocks(PIECE_ROWS)

    def whole(self) -> Recording:
        return clean(self.name, self.contents.table.table(), self.notes)


@dataclass
class ParquetPieces(Pieces):
    """A Parquet file, of which one batch of rows is in memory at a time."""

    name: str
    notes: tuple[str, ...]
    path: Path
    topics: Topics
    numeric: list[str]
    count: int

    @property
    def rows(self) -> int:
        return self.count

    @cached_property
    def time(self) -> Array:
        own = next((column for column, how in self.topics.items() if how.columns == ["time"]), "time")
        if own not in self.numeric:
            raise InputError(f"{self.name}: there is no column time; it has {', '.join(self.numeric) or 'no column'}")
        notes: list[str] = []
        with _parquet(self.path) as table:
            stamps = [batch.column(0) for batch in table.iter_batches(PIECE_ROWS, columns=[own], use_threads=False)]
        time = as_numbers(own, stamps, notes)
        self.notes = (*self.notes, *notes)
        return rename_columns(self.name, {own: time}, {own: self.topics[own]} if own in self.topics else {})["time"]

    def blocks(self) -> Iterator[Mapping[str, Array]]:
        with _parquet(self.path) as table:
            for batch in table.iter_batches(PIECE_ROWS, columns=self.numeric, use_threads=False):
                pairs = zip(batch.schema.names, batch.columns, strict=True)
                numbers = {name: as_numbers(name, [values], []) for name, values in pairs}
                yield rename_columns(self.name, numbers, self.topics)

    def whole(self) -> Recording:
        return replace(read(self.path, self.topics), name=self.name)


@dataclass
class CsvPieces(Pieces):
    """A CSV file, read twice: its stamps, and then block by block; in memory where it is no plain table of numbers."""

    name: str
    path: Path
    topics: Topics

    def __post_init__(self) -> None:
        self.notes = ()

    @property
    def rows(self) -> int:
        with self.path.open("rb") as file:
            sample = file.read(SAMPLED_BYTES)
        return int(self.path.stat().st_size / max(len(sample), 1) * max(sample.count(b"\n"), 1)) + 1

    @cached_property
    def _held(self) -> Recording | None:
        """The whole recording where the file cannot be read block by block, as with text or a line cut short."""
        try:
            for _ in self._streamed():
                pass
        except pyarrow.ArrowInvalid:
            return self.whole()
        return None

    @cached_property
    def time(self) -> Array:
        if self._held is not None:
            self.notes = self._held.notes
            return self._held.time
        found = [block["time"] for block in self.blocks() if "time" in block]
        if not found:
            raise InputError(f"{self.name}: there is no column time; it has {', '.join(csv_header(self.path)[0])}")
        return np.concatenate(found)

    def blocks(self) -> Iterator[Mapping[str, Array]]:
        if self._held is not None:
            yield from TablePieces(self._held).blocks()
            return
        for batch in self._streamed():
            pairs = zip(batch.schema.names, batch.columns, strict=True)
            named = {name: as_numbers(name, [values], []) for name, values in pairs if not name.startswith(NAMELESS)}
            yield rename_columns(self.name, named, self.topics)

    def _streamed(self) -> Iterator[pyarrow.RecordBatch]:
        names, delimiter = csv_header(self.path)
        kinds = dict.fromkeys(names, pyarrow.float64())
        with pyarrow.csv.open_csv(
            self.path,
            pyarrow.csv.ReadOptions(column_names=names, skip_rows=1, use_threads=False, block_size=8 * 2**20),
            pyarrow.csv.ParseOptions(delimiter=delimiter),
            pyarrow.csv.ConvertOptions(column_types=kinds, null_values=MISSING, strings_can_be_null=True),
        ) as table:
            yield from table

    def whole(self) -> Recording:
        return replace(read(self.path, self.topics), name=self.name)


@contextmanager
def _parquet(path: Path) -> Iterator[pyarrow.parquet.ParquetFile]:
    """The open file. Raises `InputError` where it is not a whole Parquet file."""
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            yield file
    except (pyarrow.ArrowException, OSError, *DAMAGED) as error:
        why = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"{path}: not a whole Parquet file, it may have been cut ({why})") from error
