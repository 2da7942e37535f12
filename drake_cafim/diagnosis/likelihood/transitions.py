"""How the state after a sampling interval changes with the state before it, with parameters and with efforts.

Over a smooth interval h the derivatives are those of a linear system with the coefficients of its middle,

    A = e^{hF},   B = h φ(hF) b,   φ(Z) = Σ Zᵏ/(k+1)!,   F = ∂ẋ/∂x,  b = ∂ẋ/∂θ,

exact to the second order in h (Magnus; Iserles, Acta Numerica 9, 2000). Where laws change within an interval they are
differences of the simulated end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from drake_cafim.diagnosis.likelihood.flow import Intervals, flow, rates
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

STATE_STEP, EFFORT_STEP = 1e-6, 1e-3
"""Finite differences: rad and rad/s (m and m/s); N m (N)."""
TERMS = 5
"""Of the series of e^Z and φ(Z)."""
STEPS_PER_DERIVATIVE_STEP = 4
"""Of the steps in which a state is known to rounding, how many are one for its derivatives."""
INTERVALS_AT_ONCE = 4_000
"""Number of intervals whose derivatives are computed together, to limit memory."""


@dataclass(frozen=True)
class Displaced:
    """The physics with one parameter displaced by `size`, and the intervals with the efforts that then act."""

    physics: Physics
    size: float
    intervals: Intervals


@dataclass(frozen=True)
class Transitions:
    """`after` (B, 2n), and its derivatives by the state (B, 2n, 2n), by the parameters (B, 2n, p) and by the efforts.

    Those are (B, 2n, n) each, by the effort at the interval's start and at its end.
    """

    after: Array
    by_state: Array
    by_parameters: Array
    by_first: Array
    by_last: Array


COLUMNS = tuple(column.name for column in fields(Transitions))


def transitions(
    physics: Physics, displaced: Sequence[Displaced], state: Array, intervals: Intervals, steps: Indices
) -> Transitions:
    """Those of each interval from `state` (B, 2n), integrated in `steps` (B,) steps."""
    after = flow(physics, state, intervals, steps)
    parts = [
        _of_the_middle(
            physics,
            [replace(other, intervals=other.intervals.at(block)) for other in displaced],
            state[block],
            after[block],
            intervals.at(block),
        )
        for block in np.split(np.arange(len(state)), np.arange(INTERVALS_AT_ONCE, len(state), INTERVALS_AT_ONCE))
    ]
    found = Transitions(*(np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS))
    rough = np.flatnonzero(steps > np.min(steps))
    if len(rough):
        others = [replace(other, intervals=other.intervals.at(rough)) for other in displaced]
        fewer = np.maximum(steps[rough] // STEPS_PER_DERIVATIVE_STEP, np.min(steps))
        exact = _by_differences(physics, others, state[rough], intervals.at(rough), fewer)
        for name in COLUMNS[1:]:
            getattr(found, name)[rough] = getattr(exact, name)
    return found


def _of_the_middle(
    physics: Physics, displaced: Sequence[Displaced], state: Array, after: Array, intervals: Intervals
) -> Transitions:
    B, size = state.shape
    n = size // 2
    x, h = 0.5 * (state + after), intervals.duration
    time, effort = intervals.time + 0.5 * h, 0.5 * (intervals.first + intervals.last)

    def rate(item: Physics, at: Array, u: Array) -> Array:
        return rates(item, at, u, time, intervals.recording)

    now = rate(physics, x, effort)
    F = np.stack([(rate(physics, x + e, effort) - now) / STATE_STEP for e in STATE_STEP * np.eye(size)], axis=2)
    columns = [
        (rate(other.physics, x, 0.5 * (other.intervals.first + other.intervals.last)) - now) / other.size
        for other in displaced
    ]
    b = np.stack(columns, axis=2) if columns else np.zeros((B, size, 0))
    by_effort = [(rate(physics, x, effort + e) - now) / EFFORT_STEP for e in EFFORT_STEP * np.eye(n)]
    G = np.stack(by_effort, axis=2)
    Z = h[:, None, None] * F
    power = np.tile(np.eye(size), (B, 1, 1))
    exponential, mean, factorial = power.copy(), power.copy(), 1.0
    for k in range(1, TERMS + 1):
        power, factorial = power @ Z, factorial * k
        exponential += power / factorial
        mean += power / (factorial * (k + 1))
    step = h[:, None, None]
    # an effort that grows to the end of an interval moves it less than one that falls: ∫ s/h (1 + F (h − s)) ds
    last = step * (0.5 * G + Z @ G / 6.0)
    return Transitions(after, exponential, step * (mean @ b), step * (mean @ G) - last, last)


def _by_differences(
    physics: Physics, displaced: Sequence[Displaced], state: Array, intervals: Intervals, steps: Indices
) -> Transitions:
    size = state.shape[1]
    n, after = size // 2, flow(physics, state, intervals, steps)
    by_state = [(flow(physics, state + e, intervals, steps) - after) / STATE_STEP for e in STATE_STEP * np.eye(size)]
    columns = [(flow(other.physics, state, other.intervals, steps) - after) / other.size for other in displaced]
    ends = []
    for first, last in ((1.0, 0.0), (0.0, 1.0)):
        moved = [
            replace(intervals, first=intervals.first + first * e, last=intervals.last + last * e)
            for e in EFFORT_STEP * np.eye(n)
        ]
        ends.append(np.stack([(flow(physics, state, item, steps) - after) / EFFORT_STEP for item in moved], axis=2))
    by_parameters = np.stack(columns, axis=2) if columns else np.zeros((len(state), size, 0))
    return Transitions(after, np.stack(by_state, axis=2), by_parameters, *ends)
