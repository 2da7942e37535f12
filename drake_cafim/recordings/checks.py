"""Checks of a file's columns: what makes the file unusable raises an error, what can be left out gets a note."""

from collections.abc import Mapping, Sequence

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

INTERVALS_LISTED = 3  # a note lists this many intervals and counts the rest
GAP = 10.0  # a step longer than this many median steps is a gap: jitter and a few lost samples are not


def clean(name: str, table: Mapping[str, Array], notes: Sequence[str] = ()) -> Recording:
    """The `Recording` of a file's raw columns, `time` among them; `notes` and what was left out are its notes.

    Infinite values become NaN; NaN stays; rows that repeat the stamp of the row before are removed; each has a note.
    Raises `InputError` for no samples, no `time`, NaN or infinity in `time`, and decreasing time.
    """
    if "time" not in table:
        there = ", ".join(table) or "no column at all"
        raise InputError(f"{name}: there is no column time; it has {there}")
    time = np.asarray(table["time"], dtype=np.float64)
    if time.size == 0:
        raise InputError(f"{name}: the file is empty, it has columns but not one sample")
    _check_time(name, time)
    fresh = np.concatenate([[True], np.diff(time) > 0.0])
    sentences = [*notes, *_describe_repeats(time, fresh)]
    time = time[fresh]
    columns: dict[str, Array] = {}
    for column, raw in table.items():
        if column != "time":
            values = np.asarray(raw, dtype=np.float64)
            values = values if fresh.all() else values[fresh]
            gone = ~np.isfinite(values)
            columns[column] = np.where(gone, np.nan, values) if gone.any() else values  # no copy of a whole column
            sentences += describe_missing(column, time, gone)
    return Recording(name=name, time=time, columns=columns, notes=(*sentences, *describe_gaps(time)))


def require(recording: Recording, columns: Sequence[str]) -> None:
    """Raises `InputError` for the first of `columns` that is missing or whose values are all NaN."""
    for column in columns:
        recording.measured(column)


def _check_time(name: str, time: Array) -> None:
    wrong = np.flatnonzero(~np.isfinite(time))
    if wrong.size:
        raise InputError(
            f"{name}: column time holds {time[wrong[0]]} in sample {wrong[0] + 1} of {time.size}, "
            "expected seconds that increase"
        )
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        i = back[0]
        raise InputError(
            f"{name}: column time decreases from {float(time[i])!r} s to {float(time[i + 1])!r} s at sample "
            f"{i + 2} of {time.size}, expected it to increase"
        )


def _describe_repeats(time: Array, fresh: np.ndarray) -> list[str]:
    rows = np.flatnonzero(~fresh)
    if rows.size == 0:
        return []
    count = f"{rows.size} rows that repeat" if rows.size > 1 else "1 row that repeats"
    return [f"time: {count} the stamp of the row before, left out at {_times(time[rows])}"]


def describe_missing(column: str, time: Array, gone: np.ndarray) -> list[str]:
    """One sentence with the intervals where `column` has no measurement (`gone` (N,) bool), or none."""
    if not gone.any():
        return []
    if gone.all():
        return [f"{column}: nothing but NaN, left out"]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]).astype(np.int8)))
    first, last = edges[0::2], edges[1::2] - 1
    # In a table of topics with different stamps most rows lack a measurement: a list of intervals would say nothing.
    if first.size > max(INTERVALS_LISTED, 0.05 * time.size):
        return [f"{column}: no measurement in {gone.sum()} of {time.size} samples, left out"]
    intervals = [f"{_span(time[i], time[j])} ({j - i + 1})" for i, j in zip(first, last, strict=True)]
    return [f"{column}: no measurement in {gone.sum()} samples, left out in {_listed(intervals)}"]


def describe_gaps(time: Array) -> list[str]:
    """One sentence with the intervals longer than `GAP` median steps between two samples, or none."""
    steps = np.diff(time)
    if steps.size < 3:  # of two steps neither is the rule
        return []
    median = float(np.median(steps))
    wide = np.flatnonzero(steps > GAP * median)
    if wide.size == 0:
        return []
    intervals = [_span(time[i], time[i + 1]) for i in wide]
    return [f"time: no samples in {_listed(intervals)}, where the median step is {median:.6g} s"]


def _span(start: float, end: float) -> str:
    return f"{start:.6g} s" if start == end else f"{start:.6g} to {end:.6g} s"


def _times(stamps: Array) -> str:
    return _listed([f"{stamp:.6g} s" for stamp in stamps])


def _listed(items: Sequence[str]) -> str:
    listed = ", ".join(items[:INTERVALS_LISTED])
    more = len(items) - INTERVALS_LISTED
    return listed if more <= 0 else f"{listed} and {more} more"
