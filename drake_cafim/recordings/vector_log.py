"""A recording out of Drake's own logger."""

from collections.abc import Sequence
from typing import cast

from pydrake.systems.primitives import VectorLog

from drake_cafim.errors import InputError
from drake_cafim.recordings.checks import cleaned
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array


def from_vector_log(log: VectorLog, columns: Sequence[str], name: str = "VectorLog") -> Recording:
    """The log of a `VectorLogSink` (`sink.FindLog(context)`) under the given column names.

    `columns` names the n elements of the logged vector in their order; "" leaves one out. A stamp that was
    logged twice, as by a publish at the start of each advance, is left out and noted. Raises `InputError` when
    the number of names is not n.
    """
    data = cast(Array, log.data())  # (n, N); the stub says a scalar
    if data.shape[0] != len(columns):
        raise InputError(f"{name}: the log holds {data.shape[0]} elements, expected {len(columns)} as columns names")
    named = {column: values for column, values in zip(columns, data, strict=True) if column}
    return cleaned(name, {"time": log.sample_times(), **named})
