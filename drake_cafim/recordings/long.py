"""Recordings that are longer than memory should hold: read once in pieces, kept on disk in parts that fit."""

import mmap
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import IO

import numpy as np
import pyarrow
import pyarrow.parquet

from drake_cafim.errors import InputError
from drake_cafim.output import describe_error
from drake_cafim.recordings.checks import clean, describe_missing
from drake_cafim.recordings.pieces import Pieces
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class LongRecording:
    """One recording in parts of neighbouring samples, on disk until `close`; a killed process leaves nothing of it."""

    name: str
    notes: tuple[str, ...]
    spans: tuple[tuple[float, float], ...]
    """First and last stamp of each part, s, in the recording's own time."""
    columns: tuple[str, ...]
    disk: mmap.mmap
    """The parts, each a row group of a Parquet file; mapped, so that copies of this process read it independently."""

    def __len__(self) -> int:
        """The number of parts."""
        return len(self.spans)

    def part(self, k: int) -> Recording:
        """The samples of part `k` under the recording's own name and time; `notes` are those of the whole recording."""
        with pyarrow.parquet.ParquetFile(pyarrow.BufferReader(pyarrow.py_buffer(self.disk))) as file:
            table = file.read_row_group(k, use_threads=False)
        self.disk.madvise(mmap.MADV_DONTNEED)  # else the whole file stays in memory once it has been read
        columns = {name: np.asarray(table[name], dtype=np.float64) for name in self.columns}
        return Recording(self.name, np.asarray(table["time"], dtype=np.float64), columns)

    def close(self) -> None:
        """Give the disk back, once nothing reads from it any more."""
        with suppress(BufferError):
            self.disk.close()


def in_parts(pieces: Pieces, rows: int) -> LongRecording:
    """The recording that `pieces` read, in as few equal parts of at most `rows` samples as there can be.

    Memory holds the stamps, a part and a piece. Raises `InputError` as `read` does, and where the disk is full.
    """
    time = pieces.time
    stamps = clean(pieces.name, {"time": time})
    check_usable(stamps, ())
    fresh = np.concatenate([[True], np.diff(time) > 0.0])
    count = max(1, -(-len(stamps) // rows))
    edges = [round(k * len(stamps) / count) for k in range(count + 1)]
    gone: dict[str, Flags] = {}
    try:
        with tempfile.TemporaryFile() as file:
            columns = _write(_regrouped(_kept(pieces, fresh, gone), edges), file)
            file.flush()
            # the file stays on disk as long as it is mapped
            disk = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise InputError(
            f"{pieces.name}: its parts cannot be kept in {tempfile.gettempdir()} ({describe_error(error)}), expected "
            "room for them, or another folder in TMPDIR"
        ) from error
    missing = [note for name, mask in gone.items() for note in describe_missing(name, stamps.time, mask)]
    spans = tuple((float(stamps.time[a]), float(stamps.time[b - 1])) for a, b in pairwise(edges))
    notes = tuple(dict.fromkeys((*pieces.notes, *stamps.notes, *missing)))
    return LongRecording(pieces.name, notes, spans, columns, disk)


def _write(parts: Iterator[dict[str, Array]], file: IO[bytes]) -> tuple[str, ...]:
    """Writes each part as a row group; returns the names of the columns but `time`."""
    writer: pyarrow.parquet.ParquetWriter | None = None
    columns: tuple[str, ...] = ()
    for part in parts:
        table = pyarrow.table(part)
        if writer is None:
            columns = tuple(name for name in table.column_names if name != "time")
            writer = pyarrow.parquet.ParquetWriter(file, table.schema, compression="lz4")
        writer.write_table(table, row_group_size=max(len(table), 1))
    if writer is not None:
        writer.close()
    return columns


def _kept(pieces: Pieces, fresh: Flags, gone: dict[str, Flags]) -> Iterator[dict[str, Array]]:
    """The blocks without rows that repeat a stamp; what is not finite becomes NaN, and is marked in `gone`."""
    count, first, after = int(np.sum(fresh)), 0, 0
    for block in pieces.blocks():
        rows = len(next(iter(block.values())))
        keep = fresh[first : first + rows]
        result = {"time": pieces.time[first : first + rows][keep]}
        for name, values in block.items():
            if name == "time":
                continue
            own = values if keep.all() else values[keep]
            wrong = ~np.isfinite(own)
            if wrong.any():
                mask = gone.setdefault(name, np.zeros(count, dtype=bool))
                mask[after : after + len(own)] = wrong
                own = np.where(wrong, np.nan, own)
            result[name] = np.ascontiguousarray(own)
        first, after = first + rows, after + len(result["time"])
        yield result


def _regrouped(blocks: Iterator[dict[str, Array]], edges: Sequence[int]) -> Iterator[dict[str, Array]]:
    """The rows of all blocks, cut at `edges` instead."""
    held: dict[str, list[Array]] = {}
    have = 0
    wanted = (stop - start for start, stop in pairwise(edges))
    size = next(wanted, 0)
    for block in blocks:
        start, rows = 0, len(block["time"])
        while start < rows:
            stop = min(rows, start + size - have)
            for name, values in block.items():
                held.setdefault(name, []).append(values[start:stop])
            have, start = have + stop - start, stop
            if have == size:
                yield {name: np.concatenate(parts) for name, parts in held.items()}
                held, have = {}, 0
                size = next(wanted, 0)
