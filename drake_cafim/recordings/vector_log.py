"""Conversion of Drake's `VectorLog` to a recording."""

from collections.abc import Sequence
from typing import cast

from pydrake.systems.primitives import VectorLog

from drake_cafim.errors import InputError
from drake_cafim.recordings.checks import clean
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array


def from_vector_log(log: VectorLog, columns: Sequence[str], name: str = "VectorLog") -> Recording:
    """The recording of the log of a `VectorLogSink` (`sink.FindLog(context)`).

    `columns` names the n elements of the logged vector in order; "" leaves an element out. A sample with the stamp
    of the sample before, as from a publish at the start of each advance, is left out, with a note. Raises
    `InputError` when the number of names is not n.
    """
    data = cast(Array, log.data())  # (n, N); the stub says a scalar
    if data.shape[0] != len(columns):
        raise InputError(f"{name}: the log holds {data.shape[0]} elements, expected {len(columns)} as columns names")
    named = {column: values for column, values in zip(columns, data, strict=True) if column}
    return clean(name, {"time": log.sample_times(), **named})
