"""Reading and writing of Parquet tables."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

from drake_cafim.errors import InputError
from drake_cafim.recordings.columns import as_numbers, numeric_columns
from drake_cafim.recordings.limits import check_size
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

GROUP_ROWS = 131072  # rows of a row group, so that long recordings are read and written piece by piece
# What PyArrow raises on damaged metadata beside its own exceptions, as on column names that are no UTF-8.
DAMAGED = (ValueError, OverflowError, TypeError, KeyError, IndexError, MemoryError, AttributeError)


def read_parquet(path: Path) -> tuple[dict[str, Array], list[str]]:
    """The numeric columns of the file by name, and a note for each column that is left out.

    The file is read piece by piece, and columns without numbers not at all, so that memory holds the result and one
    row group. Raises `InputError` when the file is not a whole Parquet file, claims more than it can hold, or a
    signal's column is not numeric.
    """
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            names, notes = numeric_columns(str(path), file.schema_arrow)
            check_size(path, 8 * max(file.metadata.num_rows, 0) * len(names))
            pieces: dict[str, list[pyarrow.Array]] = {name: [] for name in names}
            for batch in file.iter_batches(batch_size=GROUP_ROWS, columns=names, use_threads=False):
                for name, values in zip(batch.schema.names, batch.columns, strict=True):
                    pieces[name].append(values)
            return {name: as_numbers(name, pieces.pop(name), notes) for name in names}, notes
    except (pyarrow.ArrowException, OSError, *DAMAGED) as error:
        why = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"{path}: not a whole Parquet file, it may have been cut ({why})") from error


def write_parquet(recording: Recording, path: Path) -> None:
    """Write float64 columns, `time` first; the same recording gives the same bytes."""
    table = {"time": recording.time, **recording.columns}
    starts = range(0, max(len(recording), 1), GROUP_ROWS)
    write_blocks(({name: values[i : i + GROUP_ROWS] for name, values in table.items()} for i in starts), path)


def write_blocks(blocks: Iterable[Mapping[str, Array]], path: Path) -> None:
    """Write the blocks of one table, each as a row group; all have the columns of the first."""
    writer: pyarrow.parquet.ParquetWriter | None = None
    try:
        for block in blocks:
            columns = {name: np.ascontiguousarray(values) for name, values in block.items()}
            table = pyarrow.table(columns)
            if writer is None:
                writer = pyarrow.parquet.ParquetWriter(path, table.schema, compression="zstd")
            writer.write_table(table, row_group_size=GROUP_ROWS)
    finally:
        if writer is not None:
            writer.close()
