"""Conversion of Arrow columns to float64 columns; columns without numbers are refused or left out."""

import numpy as np
import pyarrow
import pyarrow.compute

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import is_signal
from drake_cafim.typing import Array

NUMERIC = (
    pyarrow.types.is_floating,
    pyarrow.types.is_integer,
    pyarrow.types.is_boolean,
    pyarrow.types.is_decimal,
)
INDEX_PREFIX = "__index_level_"  # the row index that pandas writes beside the columns


def as_numbers(name: str, table: pyarrow.Table) -> tuple[dict[str, Array], list[str]]:
    """The numeric columns by name, (N,) float64 with null as NaN, and a note for each column that is left out.

    Dates and durations in `time` become seconds since the first stamp, subtracted as integers.
    Raises `InputError` when `time` or a signal's column is not numeric, or a name occurs twice.
    """
    numbers: dict[str, Array] = {}
    notes: list[str] = []
    for column, values in zip(table.column_names, table.columns, strict=True):
        if column.startswith(INDEX_PREFIX):
            continue
        if column in numbers:
            raise InputError(f"{name}: column {column} occurs twice, expected once")
        kind = values.type
        if any(is_kind(kind) for is_kind in NUMERIC):
            numbers[column] = _floats(values)
        elif pyarrow.types.is_null(kind):
            numbers[column] = np.full(len(values), np.nan)
        elif column == "time" and (pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind)):
            numbers[column] = _seconds(values)
            notes.append(f"time: holds {kind}, taken as seconds since the first, {values[0]}")
        elif column == "time" or is_signal(column):
            raise InputError(f"{name}: column {column} holds {kind}, expected numbers")
        else:
            notes.append(f"{column}: holds {kind}, not numbers, left alone")
    return numbers, notes


def _floats(values: pyarrow.ChunkedArray) -> Array:
    if values.null_count or not pyarrow.types.is_float64(values.type):
        values = pyarrow.compute.cast(values, pyarrow.float64(), safe=False)
        values = pyarrow.compute.fill_null(values, np.nan)
    return np.array(values.to_numpy(), dtype=np.float64)


def _seconds(values: pyarrow.ChunkedArray) -> Array:
    """Seconds since the first stamp (N,); a missing stamp is NaN, which the checks then refuse."""
    if len(values) == 0:
        return np.empty(0)
    unit = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[values.type.unit]
    ticks = pyarrow.compute.cast(values, pyarrow.int64())
    since = pyarrow.compute.subtract(ticks, ticks[0])
    return _floats(since) / unit
