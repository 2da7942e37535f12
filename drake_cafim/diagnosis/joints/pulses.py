"""Detects short pushes: matched filters for pulses of force at the joints, over all intervals of time.

A short push on any body is a pulse of force at the joints; on which body it acted is tested afterwards.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.pushes import Push, candidate_intervals
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.body import pulse
from drake_cafim.typing import Array

DECAYED_SHARE = 0.02
"""Norm of the last rows of a pulse over that of all, below which the rows after them are left out."""
TAIL = 8
"""Number of windows by which the rows of a pulse are extended until they have decayed."""


@dataclass(frozen=True)
class Pulse:
    """A pulse over [start, stop] s of a recording, with its `weights` (m,) in the windows from the index `first` on.

    Forces f (n,) of a unit pulse at the joints move the recording's rows by C f, and with the whitening L⁻¹ their χ² is
    |R f|², R (n, n) upper triangular; `scale` is R⁻ᵀ. So little is kept that recordings of any length may keep it.
    """

    start: float
    stop: float
    first: int
    weights: Array
    scale: Array

    def gain(self, unwhitened: Array) -> float:
        """Decrease of χ² by the pulse with its best force: |R⁻ᵀ Cᵀ L⁻ᵀ z|² for the whitened rows z of the recording.

        `unwhitened` (M, n) are those of L⁻ᵀ z that are equations of motion.
        """
        along = self.scale @ (self.weights @ unwhitened[self.first : self.first + len(self.weights)])
        return float(along @ along)


def strongest_pushes(problem: WeakFormRows, residual: Array) -> tuple[list[Push], int]:
    """The strongest push of each recording, best first, in the whitened `residual`; and the number of pulses tested."""
    found: list[Push] = []
    trials = first = 0
    for index, run in enumerate(problem.runs):
        own = run.whiten.transposed(residual[first : first + run.rows, None]).reshape(run.shape)[:, run.weak.dynamic]
        best: Push | None = None
        for tested in pulses_of(problem, index):
            trials += 1
            gain = tested.gain(own)
            if best is None or gain > best.gain:
                best = Push(index, tested.start, tested.stop, gain)
        if best is not None:
            found.append(best)
        first += run.rows
    return sorted(found, key=lambda push: -push.gain), trials


def pulses_of(problem: WeakFormRows, index: int) -> Sequence[Pulse]:
    """The pulses that are tested in a recording; cached, since they do not depend on the residual."""
    if index not in problem.tried_pulses:
        problem.tried_pulses[index] = list(_pulses(problem.runs[index]))
    return problem.tried_pulses[index]


def _pulses(run: Run) -> Iterator[Pulse]:
    windows = run.weak.samples.windows
    for start, duration in candidate_intervals(windows.starts[0], windows.starts[-1] + windows.width):
        candidate = _pulse(run, start, start + duration)
        if candidate is not None:
            yield candidate


def _pulse(run: Run, start: float, stop: float) -> Pulse | None:
    """The pulse over [start, stop] s; None where it touches fewer than two windows."""
    weak = run.weak
    windows, time, r = weak.samples.windows, weak.samples.time, weak.rows_per_window
    touched = np.flatnonzero((windows.starts + windows.width > start) & (windows.starts < stop))
    if len(touched) < 2:
        return None
    first, last = int(touched[0]), int(touched[-1]) + 1
    pushing = slice(*np.searchsorted(time, (start, stop)))
    weights = windows.value[first:last, pushing] @ pulse(time[pushing], start, stop)
    tail = TAIL
    while True:
        end = min(last + tail, len(windows))
        columns = np.zeros((end - first, r, weak.joints))
        for j in range(weak.joints):
            columns[: last - first, weak.dynamic.start + j, j] = -weights
        rows = slice(first * r, end * r)
        solved = run.whiten.factor.block(rows.start, rows.stop).solve(columns.reshape(-1, weak.joints))
        # a change of momentum is seen until the noise of later samples has averaged it away
        left = np.linalg.norm(solved[-TAIL * r :], axis=0) <= DECAYED_SHARE * np.linalg.norm(solved, axis=0)
        if end == len(windows) or np.all(left):
            norms = np.linalg.qr(solved, mode="r")
            return Pulse(start, stop, first, weights, np.linalg.inv(norms).T) if np.all(np.diag(norms)) else None
        tail *= 2
