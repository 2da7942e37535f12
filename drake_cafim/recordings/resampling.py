"""Resampling of a recording to a uniform period, only on request: fits use the samples as they were measured."""

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.typing import Array

HELD = ("u", "cmd")
MOST = 1e7
"""Largest number of samples: an hour at 2.8 kHz."""


def resample(recording: Recording, period: float, longest_gap: float | None = None) -> Recording:
    """The recording at multiples of `period` (s) from its first sample.

    `u` and `cmd` keep the value of the sample before; other columns are interpolated linearly, quaternions with
    continuous signs and then normalised. Across gaps longer than `longest_gap` s (by default 5 median steps of the
    column) the values are NaN. A note says that the recording was resampled. Raises `InputError` for a period that is
    not positive.
    """
    if not period > 0.0:
        raise InputError(f"{recording.name}: the period is {period} s, expected it to be positive")
    if recording.duration / period > MOST:
        raise InputError(
            f"{recording.name}: a period of {period:g} s makes more than {MOST:g} samples of its "
            f"{recording.duration:.6g} s, expected a longer one"
        )
    # 1 + 1e-12: a duration of whole periods must not lose its last sample to rounding
    count = int(np.floor(recording.duration / period * (1.0 + 1e-12))) + 1
    time = recording.time[0] + period * np.arange(count)
    source = _with_continuous_quaternions(recording)
    columns: dict[str, Array] = {}
    for column, values in source.items():
        held = column.partition(".")[0] in HELD
        columns[column] = _interpolate(time, recording.time, values, held, longest_gap)
    for body in recording.bodies:
        _normalise(columns, body)
    note = f"resampled to a period of {period:.6g} s on request; its samples were not measured at these times"
    return Recording(name=recording.name, time=time, columns=columns, notes=(*recording.notes, note))


def _interpolate(new: Array, time: Array, values: Array, held: bool, longest: float | None) -> Array:
    """`values` (N,) at `time`, interpolated or held to the times `new` (M,); NaN across gaps and outside."""
    there = np.isfinite(values)
    t, y = time[there], values[there]
    if t.size < 2:
        return np.full(new.size, np.nan)
    longest = 5.0 * float(np.median(np.diff(t))) if longest is None else longest
    before = np.searchsorted(t, new, side="right") - 1
    inside = (before >= 0) & (new <= t[-1])
    i = np.clip(before, 0, t.size - 2)
    step = t[i + 1] - t[i]
    share = np.clip((new - t[i]) / step, 0.0, 1.0)
    result = np.where(share < 1.0, y[i], y[i + 1]) if held else y[i] + share * (y[i + 1] - y[i])
    exact = (share == 0.0) | (share == 1.0)  # at a sample's own time the gap beside it does not matter
    return np.where(inside & (exact | (step <= longest)), result, np.nan)


def _with_continuous_quaternions(recording: Recording) -> dict[str, Array]:
    """The columns with each quaternion's sign chosen so that it is nearer to the quaternion of the sample before."""
    columns = dict(recording.columns)
    for body in recording.bodies:
        names = _quaternion(body)
        if not all(name in columns for name in names):
            continue
        q = np.column_stack([columns[name] for name in names])
        there = np.isfinite(q).all(axis=1)
        dots = np.sum(q[there][1:] * q[there][:-1], axis=1)
        q[there] *= np.cumprod(np.concatenate([[1.0], np.where(dots < 0.0, -1.0, 1.0)]))[: there.sum(), None]
        columns |= dict(zip(names, q.T, strict=True))
    return columns


def _normalise(columns: dict[str, Array], body: str) -> None:
    names = _quaternion(body)
    if all(name in columns for name in names):
        q = np.column_stack([columns[name] for name in names])
        columns |= dict(zip(names, (q / np.linalg.norm(q, axis=1, keepdims=True)).T, strict=True))


def _quaternion(body: str) -> list[str]:
    return [f"pose.{body}.{component}" for component in POSE_COMPONENTS[3:]]
