"""Where in the recordings a short push would explain most: matched filters for pulses of force at the joints.

A push on a body is, over its short time, some force at each joint; which body it was on is asked afterwards.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from drake_cafim.diagnosis.fit.pushes import Push, candidate_intervals
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.body import pulse
from drake_cafim.typing import Array

TAIL = 8
"""Windows behind a pulse that its whitened rows are followed through."""
KEPT = 2000
"""Windows of a recording whose pulses are kept."""


@dataclass(frozen=True)
class Pulse:
    """A pulse over [start, stop] s of a recording, and the rows that it touches.

    `directions` (R, n) are orthonormal in those whitened `rows`: what any force at each joint moves them by.
    """

    start: float
    stop: float
    rows: slice
    directions: Array

    def gain(self, residual: Array) -> float:
        """What the pulse takes off the χ² of a recording's whitened rows."""
        along = residual[self.rows] @ self.directions
        return float(along @ along)


def strongest_pushes(problem: WeakFormRows, residual: Array) -> tuple[list[Push], int]:
    """The strongest push of each recording, best first, given whitened rows; and how many pulses were tried."""
    found: list[Push] = []
    trials = first = 0
    for index, run in enumerate(problem.runs):
        own = residual[first : first + run.rows]
        gains = [(pulse.gain(own), pulse) for pulse in pulses_of(problem, index)]
        trials += len(gains)
        if gains:
            gain, best = max(gains, key=lambda one: one[0])
            found.append(Push(index, best.start, best.stop, gain))
        first += run.rows
    return sorted(found, key=lambda push: -push.gain), trials


def pulses_of(problem: WeakFormRows, index: int) -> Iterable[Pulse]:
    """The pulses that are tried in one recording; those of a short one are kept, whatever the residual."""
    run = problem.runs[index]
    if len(run.weak.samples.windows) > KEPT:
        return _laid_out(run)
    if index not in problem.tried_pulses:
        problem.tried_pulses[index] = list(_laid_out(run))
    return problem.tried_pulses[index]


def _laid_out(run: Run) -> Iterator[Pulse]:
    windows = run.weak.samples.windows
    for start, duration in candidate_intervals(windows.starts[0], windows.starts[-1] + windows.width):
        one = _laid(run, start, start + duration)
        if one is not None:
            yield one


def _laid(run: Run, start: float, stop: float) -> Pulse | None:
    """The pulse in whitened rows."""
    weak = run.weak
    windows, time, r = weak.samples.windows, weak.samples.time, weak.rows_per_window
    touched = np.flatnonzero((windows.starts + windows.width > start) & (windows.starts < stop))
    if len(touched) < 2:
        return None
    first, last = int(touched[0]), min(int(touched[-1]) + 1 + TAIL, len(windows))
    pushing = slice(*np.searchsorted(time, (start, stop)))
    weights = windows.value[first:last, pushing] @ pulse(time[pushing], start, stop)
    columns = np.zeros((last - first, r, weak.joints))
    for j in range(weak.joints):
        columns[:, weak.dynamic.start + j, j] = -weights
    rows = slice(first * r, last * r)
    solved, info = lapack.dtbtrs(run.whiten.factor[:, rows], columns.reshape(-1, weak.joints), uplo="L")
    return None if info != 0 else Pulse(start, stop, rows, np.linalg.qr(solved)[0])
