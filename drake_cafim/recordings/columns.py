"""Conversion of Arrow columns to float64 columns; columns without numbers are refused or left out."""

from collections.abc import Sequence

import numpy as np
import pyarrow
import pyarrow.compute

from drake_cafim.errors import InputError
from drake_cafim.recordings.limits import check_columns
from drake_cafim.recordings.recording import is_signal
from drake_cafim.typing import Array

NUMERIC = (
    pyarrow.types.is_floating,
    pyarrow.types.is_integer,
    pyarrow.types.is_boolean,
    pyarrow.types.is_decimal,
    pyarrow.types.is_null,
)
INDEX_PREFIX = "__index_level_"  # the row index that pandas writes beside the columns


def numeric_columns(name: str, schema: pyarrow.Schema) -> tuple[list[str], list[str]]:
    """The names of the columns that hold numbers, and a note for each of the others.

    Raises `InputError` when `time` or a signal's column is not numeric, a name occurs twice, or there are too many.
    """
    check_columns(name, len(schema))
    found: dict[str, bool] = {}
    notes: list[str] = []
    for field in schema:
        column, kind = field.name, field.type
        if column.startswith(INDEX_PREFIX):
            continue
        if column in found:
            raise InputError(f"{name}: column {column} occurs twice, expected once")
        found[column] = any(is_kind(kind) for is_kind in NUMERIC) or (column == "time" and _is_clock(kind))
        if found[column]:
            continue
        if column == "time" or is_signal(column):
            raise InputError(f"{name}: column {column} holds {kind}, expected numbers")
        notes.append(f"{column}: holds {kind}, not numbers, left alone")
    return [column for column, is_numeric in found.items() if is_numeric], notes


def as_numbers(column: str, pieces: Sequence[pyarrow.Array], notes: list[str]) -> Array:
    """The column in `pieces` as (N,) float64 with null as NaN.

    Dates and durations become seconds since the first stamp, subtracted as integers, with a note.
    """
    if pieces and _is_clock(pieces[0].type):
        values = pyarrow.chunked_array(pieces)
        if len(values):
            notes.append(f"{column}: holds {values.type}, taken as seconds since the first, {_first(values)}")
        return _seconds(values)
    return np.concatenate([_floats(piece) for piece in pieces]) if pieces else np.empty(0)


def _is_clock(kind: pyarrow.DataType) -> bool:
    return bool(pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind))


def _first(stamps: pyarrow.ChunkedArray) -> str:
    """The first stamp as text; as a number where it is outside the calendar or in a time zone that is not known."""
    try:
        return str(stamps[0])
    except (ValueError, OverflowError, ArithmeticError, pyarrow.ArrowException, ImportError, KeyError):
        return str(pyarrow.compute.cast(stamps[:1], pyarrow.int64())[0])


def _floats(values: pyarrow.Array | pyarrow.ChunkedArray) -> Array:
    if pyarrow.types.is_null(values.type):
        return np.full(len(values), np.nan)
    if values.null_count or not pyarrow.types.is_float64(values.type):
        values = pyarrow.compute.cast(values, pyarrow.float64(), safe=False)
        values = pyarrow.compute.fill_null(values, np.nan)
    return np.asarray(values, dtype=np.float64)


def _seconds(values: pyarrow.ChunkedArray) -> Array:
    """Seconds since the first stamp (N,); a missing stamp is NaN, which the checks then refuse."""
    if len(values) == 0:
        return np.empty(0)
    unit = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[values.type.unit]
    ticks = pyarrow.compute.cast(values, pyarrow.int64())
    since = pyarrow.compute.subtract(ticks, ticks[0])
    return _floats(since) / unit
