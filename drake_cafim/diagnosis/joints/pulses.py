"""Detects short pushes: matched filters for pulses of force at the joints, over all intervals of time.

A short push on any body is a pulse of force at the joints; on which body it acted is tested afterwards.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.pushes import Push, candidate_intervals
from drake_cafim.diagnosis.fit.screening import LEAST_INFORMATION
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.whitening.force_information import ForceInformation
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.body import pulse
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Pulse:
    """A pulse over [start, stop] s of a recording, with its `weights` (m,) in the windows from the index `first` on.

    Forces f (n,) of a unit pulse at the joints move the recording's rows by C f, and with the whitening L⁻¹ their χ² is
    fᵀKf, K = Cᵀ(LLᵀ)⁻¹C. `scale` is an S (k, n) with SᵀS = K⁻¹, or its pseudo-inverse where forces are not told apart.
    So little is kept that recordings of any length may keep it.
    """

    start: float
    stop: float
    first: int
    weights: Array
    scale: Array

    def gain(self, unwhitened: Array) -> float:
        """Decrease of χ² by the pulse with its best force: |S Cᵀ L⁻ᵀ z|² for the whitened rows z of the recording.

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
        run, information = problem.runs[index], force_information(problem, index)
        tested = (_pulse(run, information, *candidate) for candidate in _candidates(run))
        problem.tried_pulses[index] = [candidate for candidate in tested if candidate is not None]
    return problem.tried_pulses[index]


def force_information(problem: WeakFormRows, index: int) -> ForceInformation:
    """What a recording's rows tell of forces at the joints, of those together over which a pulse is tested; cached."""
    known, run = problem.force_information, problem.runs[index]
    if index not in known:
        known[index] = ForceInformation.of(run, max((last - first for *_, first, last in _candidates(run)), default=1))
    return known[index]


def _candidates(run: Run) -> Iterator[tuple[float, float, int, int]]:
    """Start and stop, s, of the pulses that touch two windows or more, the first one and the one after the last."""
    windows = run.weak.samples.windows
    for start, duration in candidate_intervals(windows.starts[0], windows.starts[-1] + windows.width):
        stop = start + duration
        touched = np.flatnonzero((windows.starts + windows.width > start) & (windows.starts < stop))
        if len(touched) > 1:
            yield start, stop, int(touched[0]), int(touched[-1]) + 1


def _pulse(run: Run, information: ForceInformation, start: float, stop: float, first: int, last: int) -> Pulse | None:
    """The pulse over [start, stop] s in the windows from `first` on; None where its force at a joint is not felt."""
    windows, time = run.weak.samples.windows, run.weak.samples.time
    pushing = slice(*np.searchsorted(time, (start, stop)))
    weights = windows.value[first:last, pushing] @ pulse(time[pushing], start, stop)
    products = information.of_pulse(first, weights)
    size = np.sqrt(np.diag(products))
    if not np.all(size > 0.0):
        return None
    known, axes = np.linalg.eigh(products / np.outer(size, size))
    # forces that rows do not tell apart, but for rounding, count once
    distinct = known > LEAST_INFORMATION * known[-1]
    return Pulse(start, stop, first, weights, (axes[:, distinct] / np.sqrt(known[distinct])).T / size)
