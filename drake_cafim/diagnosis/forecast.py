"""Forward simulation over windows of a second: what the model predicts, against what was recorded."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.rotors import taken_by_rotors
from drake_cafim.diagnosis.stepper import State, advance, driven
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.dynamics.motion import motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

HORIZON = 1.0
"""s"""
DIVERGED = 1e3
"""rad (m) or more times the motion's range: a simulation is stopped there and its error counted at that."""


@dataclass(frozen=True)
class Forecast:
    """One recording simulated window after window: `time` (K,), `window` (K,), and by column predicted and measured."""

    recording: str
    time: Array
    window: np.ndarray[tuple[int], np.dtype[np.int64]]
    predicted: dict[str, Array]
    measured: dict[str, Array]


def forecast(weak: WeakForm, physics: Physics, horizon: float = HORIZON) -> Forecast:
    """The recording's windows of `horizon` s under `physics`, open loop in u; each starts from its 50 ms before."""
    return forecasts([weak], physics, horizon)[0]


def forecasts(forms: Sequence[WeakForm], physics: Physics, horizon: float = HORIZON) -> list[Forecast]:
    """The forecast of each recording; the windows of all are simulated side by side."""
    courses, states = [], []
    for weak in forms:
        own = _courses(weak, physics, horizon)
        measured, memory = weak.measurement(physics), weak.contact_memory(physics)
        courses.append(own)
        states += [(*state_at(weak.samples, measured, one.start)[:2], memory[one.start]) for one in own]
    limit = DIVERGED * (1.0 + np.max([np.ptp(weak.measurement(physics).q, axis=0) for weak in forms], axis=0))
    state = State(*(np.stack([one[k] for one in states]) for k in range(3)))
    together = [one for own in courses for one in own]
    trail = _simulated(physics, state, together, limit)
    result, first = [], 0
    for weak, own in zip(forms, courses, strict=True):
        result.append(_gather(weak, physics, own, [trail[first + k] for k in range(len(own))]))
        first += len(own)
    return result


@dataclass(frozen=True)
class _Course:
    """One window: samples `start` to `stop`, and what drives it, `duration` (K,) s and `effort` (K, n) held over them.

    `marks` (stop − start + 1,) are how many of them lie before each sample.
    """

    start: int
    stop: int
    duration: Array
    effort: Array
    marks: np.ndarray[tuple[int], np.dtype[np.int64]]


def _courses(weak: WeakForm, physics: Physics, horizon: float) -> list[_Course]:
    time = weak.samples.time
    knots, efforts = driven(physics, time, weak.measurement(physics).u)
    taken = taken_by_rotors(weak, physics)
    result = []
    for start in _starts(time, horizon):
        stop = int(np.searchsorted(time, time[start] + horizon + 1e-9, side="right")) - 1
        own = time[start : stop + 1]
        within = knots[(knots > own[0] + 1e-12) & (knots < own[-1] - 1e-12)]
        edges = np.unique(np.concatenate([own, within]))
        held = np.clip(np.searchsorted(knots, edges[:-1] + 1e-12, side="right") - 1, 0, None)
        rotors = taken[np.searchsorted(time, edges[:-1] + 1e-12, side="right") - 1]
        result.append(_Course(start, stop, np.diff(edges), efforts[held] + rotors, np.searchsorted(edges, own)))
    return result


def _simulated(physics: Physics, state: State, courses: Sequence[_Course], limit: Array) -> list[State]:
    """The states of each course at its samples."""
    steps = max(len(one.duration) for one in courses)
    duration = np.zeros((steps, len(courses)))
    effort = np.zeros((steps, *state.q.shape))
    for k, one in enumerate(courses):
        duration[: len(one.duration), k] = one.duration
        effort[: len(one.duration), k] = one.effort
    trail = [state]
    for k in range(steps):
        state = _bounded(advance(physics, state, effort[k], duration[k]), limit)
        trail.append(state)
    q, v = np.stack([one.q for one in trail]), np.stack([one.v for one in trail])
    memory = None if state.memory is None else np.stack([one.memory for one in trail if one.memory is not None])
    return [
        State(q[one.marks, k], v[one.marks, k], None if memory is None else memory[one.marks, k])
        for k, one in enumerate(courses)
    ]


def root_mean_square(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """By column, over all windows of all recordings."""
    result = {}
    for column in forecasts[0].predicted:
        errors = np.concatenate([f.predicted[column] - f.measured[column] for f in forecasts])
        result[column] = float(np.sqrt(np.nanmean(errors**2)))
    return result


def _starts(time: Array, horizon: float) -> list[int]:
    """Indices at which windows begin, one horizon apart, after the first look back; one window if it is short."""
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first + 1e-9) / horizon))
    return [int(np.searchsorted(time, first + k * horizon - 1e-9)) for k in range(count)]


def _bounded(state: State, limit: Array) -> State:
    lost = ~np.isfinite(state.q) | (np.abs(state.q) > limit) | ~np.isfinite(state.v)
    if not np.any(lost):
        return state
    rows = np.any(lost, axis=1, keepdims=True)
    return State(np.where(rows, limit, state.q), np.where(rows, 0.0, state.v), state.memory)


def _gather(weak: WeakForm, physics: Physics, courses: Sequence[_Course], states: Sequence[State]) -> Forecast:
    """Predicted and measured columns of all windows, end to end; sensor effects are put back into the prediction."""
    samples, names = weak.samples, physics.tree.joint_names
    index = np.concatenate([np.arange(one.start, one.stop + 1) for one in courses])
    window = np.concatenate([np.full(one.stop - one.start + 1, w) for w, one in enumerate(courses)])
    q_flat, v_flat = np.concatenate([one.q for one in states]), np.concatenate([one.v for one in states])
    predicted = {f"q.{name}": q_flat[:, j].copy() for j, name in enumerate(names)}
    if samples.velocity_measured:
        predicted |= {f"v.{name}": v_flat[:, j].copy() for j, name in enumerate(names)}
    if weak.sensors:
        moving = motion(physics.tree, q_flat, v_flat)
        memory = [one.memory for one in states if one.memory is not None]
        wrenches = physics.contact_wrenches(moving, np.concatenate(memory))
        for sensor in weak.sensors:
            reading = sensor.reading(moving, wrenches[:, sensor.joint])
            predicted |= {
                f"wrench.{sensor.name}.{axis}": reading[:, k].copy()
                for k, axis in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))
            }
    time = samples.time[index]
    for effect in physics.sensors:
        on = [name for name in effect.channels(list(predicted)) if name in predicted]
        for w in range(len(courses) if on else 0):
            rows = window == w
            written = effect.measured(time[rows], np.stack([predicted[name][rows] for name in on], axis=1))
            for k, name in enumerate(on):
                predicted[name][rows] = written[:, k]
    columns = samples.recording.columns
    return Forecast(samples.recording.name, time, window, predicted, {name: columns[name][index] for name in predicted})
