"""Reading and writing of Parquet tables."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

from drake_cafim.errors import InputError
from drake_cafim.recordings.columns import as_numbers
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

GROUP_ROWS = 131072  # rows of a row group, so that long recordings are written piece by piece


def read_parquet(path: Path) -> tuple[dict[str, Array], list[str]]:
    """The numeric columns of the file by name, and a note for each column that is left out.

    Raises `InputError` when the file is not a whole Parquet file or a signal's column is not numeric.
    """
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            table = file.read()
    except (pyarrow.ArrowException, OSError) as error:
        why = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"{path}: not a whole Parquet file, it may have been cut ({why})") from error
    return as_numbers(str(path), table)


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
