"""Parquet tables, in and out."""

from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

from drake_cafim.errors import InputError
from drake_cafim.recordings.columns import as_numbers
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array


def read_parquet(path: Path) -> tuple[dict[str, Array], list[str]]:
    """The numeric columns of the file, and notes on those that are left alone.

    Raises `InputError` when the file is not a whole Parquet file or a signal's column is not numeric.
    """
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            table = file.read()
    except (pyarrow.ArrowException, OSError) as error:
        why = _first(error)
        raise InputError(f"{path}: not a whole Parquet file, it may have been cut ({why})") from error
    return as_numbers(str(path), table)


def write_parquet(recording: Recording, path: Path) -> None:
    """Write float64 columns, `time` first; the same recording gives the same bytes."""
    arrays = {"time": recording.time, **recording.columns}
    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in arrays.items()})
    pyarrow.parquet.write_table(table, path, compression="zstd")


def _first(error: Exception) -> str:
    return str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
