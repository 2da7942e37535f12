"""Where in the recordings a short push would explain most: matched filters for pulses of force at the joints.

A push on a body is, over its short time, some force at each joint; which body it was on is asked afterwards.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from drake_cafim.diagnosis.weak_problem import Run, WeakProblem
from drake_cafim.effects.body import pulse
from drake_cafim.typing import Array

DURATIONS = (0.07, 0.12, 0.2, 0.35, 0.6)
"""s"""
SPACING = 0.3
"""Of a duration, from one trial to the next."""
TAIL = 8
"""Windows behind a pulse that its whitened rows are followed through."""


@dataclass(frozen=True)
class Push:
    """A pulse over [start, stop] s of the recording with this index, and the χ² that forces at the joints gain."""

    run: int
    start: float
    stop: float
    gain: float


def strongest_pushes(problem: WeakProblem, residual: Array) -> tuple[list[Push], int]:
    """The strongest push of each recording, best first, given whitened rows; and how many pulses were tried."""
    found: list[Push] = []
    trials = first = 0
    for index, run in enumerate(problem.runs):
        stop = first + len(run.weak.samples.windows) * run.weak.rows_per_window
        pushes = _pushes(run, index, residual[first:stop])
        trials += len(pushes)
        if pushes:
            found.append(max(pushes, key=lambda push: push.gain))
        first = stop
    return sorted(found, key=lambda push: -push.gain), trials


def _pushes(run: Run, index: int, residual: Array) -> list[Push]:
    windows = run.weak.samples.windows
    pushes: list[Push] = []
    for duration in DURATIONS:
        begin, end = windows.starts[0], windows.starts[-1] + windows.width - duration
        for start in np.arange(begin, end, SPACING * duration):
            gain = _gain(run, residual, float(start), float(start) + duration)
            if gain is not None:
                pushes.append(Push(index, float(start), float(start) + duration, gain))
    return pushes


def _gain(run: Run, residual: Array, start: float, stop: float) -> float | None:
    """What a pulse of any force at each joint takes off χ², by the rows that it touches."""
    weak = run.weak
    windows, r = weak.samples.windows, weak.rows_per_window
    touched = np.flatnonzero((windows.starts + windows.width > start) & (windows.starts < stop))
    if len(touched) < 2:
        return None
    first, last = int(touched[0]), min(int(touched[-1]) + 1 + TAIL, len(windows))
    weights = windows.value[first:last] @ pulse(weak.samples.time, start, stop)
    columns = np.zeros((last - first, r, weak.joints))
    for j in range(weak.joints):
        columns[:, weak.dynamic.start + j, j] = -weights
    rows = slice(first * r, last * r)
    factor = run.whiten.factor[:, rows]
    solved, info = lapack.dtbtrs(factor, columns.reshape(-1, weak.joints), uplo="L")
    if info != 0:
        return None
    along = solved.T @ residual[rows]
    strength = solved.T @ solved
    strength[np.diag_indices(weak.joints)] *= 1.0 + 1e-9
    return float(along @ np.linalg.solve(strength, along))
