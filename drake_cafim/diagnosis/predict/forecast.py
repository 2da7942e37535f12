"""Forward simulation over windows of a second: what the model predicts, against what was recorded.

A simulation counts as long as every joint stays in its range. Where one leaves it, the simulation has diverged: its
state is held from there on, and no later sample counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.predict.stepper import State, advance, driven
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

HORIZON, SHORT_HORIZON = 1.0, 0.1
"""s"""
BOUNDLESS = 1e3
"""rad (m): a position limit of a model file at least as large is none."""


@dataclass(frozen=True)
class Forecast:
    """One recording simulated window after window: `time` (K,), `window` (K,), and by column predicted and measured."""

    recording: str
    time: Array
    window: np.ndarray[tuple[int], np.dtype[np.int64]]
    predicted: dict[str, Array]
    measured: dict[str, Array]
    lost: Flags | None = None
    """(K,) samples after a joint left its range, which do not count; None: there are none."""
    diverges: Mapping[str, float] = field(default_factory=dict)
    """By joint, s from a window's start until the first of them leaves its range."""

    @property
    def counted(self) -> Flags:
        """(K,) samples of simulations that have not diverged."""
        return np.ones(len(self.time), dtype=bool) if self.lost is None else ~self.lost


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
    state = State(*(np.stack([one[k] for one in states]) for k in range(3)))
    together = [one for own in courses for one in own]
    trail = _simulated(physics, state, together, joint_ranges(forms, physics))
    result, first = [], 0
    for weak, own in zip(forms, courses, strict=True):
        result.append(_gather(weak, physics, own, trail[first : first + len(own)]))
        first += len(own)
    return result


def joint_ranges(forms: Sequence[WeakForm], physics: Physics) -> Array:
    """(2, n) the least and the largest position of each joint, rad or m, that a simulation may reach.

    The model's limits, widened to what was recorded; of a joint without limits, what was recorded and a turn (of a
    prismatic joint, its stroke) more on either side.
    """
    recorded = np.concatenate([weak.measurement(physics).q for weak in forms])
    lower, upper = recorded.min(axis=0), recorded.max(axis=0)
    stroke = upper - lower
    for j, joint in enumerate(physics.tree.joints):
        least, largest = joint.position_limits
        margin = stroke[j] if joint.prismatic else 2.0 * np.pi
        lower[j] = min(lower[j], least) if least > -BOUNDLESS else lower[j] - margin
        upper[j] = max(upper[j], largest) if largest < BOUNDLESS else upper[j] + margin
    return np.stack([lower, upper])


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
    knots, efforts = driven(physics, time, weak.measurement(physics).u, weak.samples.ramped)
    taken = rotor_efforts(weak, physics)
    result = []
    for start in window_starts(time, horizon):
        stop = int(np.searchsorted(time, time[start] + horizon + 1e-9, side="right")) - 1
        own = time[start : stop + 1]
        within = knots[(knots > own[0] + 1e-12) & (knots < own[-1] - 1e-12)]
        edges = np.unique(np.concatenate([own, within]))
        held = np.clip(np.searchsorted(knots, edges[:-1] + 1e-12, side="right") - 1, 0, None)
        rotors = taken[np.searchsorted(time, edges[:-1] + 1e-12, side="right") - 1]
        result.append(_Course(start, stop, np.diff(edges), efforts[held] + rotors, np.searchsorted(edges, own)))
    return result


@dataclass(frozen=True)
class _Simulated:
    """One window: its states at its samples (K, n), and the sample and joint at which it diverged."""

    state: State
    first_lost: int | None
    joint: int


def _simulated(physics: Physics, state: State, courses: Sequence[_Course], ranges: Array) -> list[_Simulated]:
    """The states of each course at its samples, held from where a joint leaves its range, `ranges` (2, n)."""
    steps = max(len(course.duration) for course in courses)
    duration = np.zeros((steps, len(courses)))
    effort = np.zeros((steps, *state.q.shape))
    for k, course in enumerate(courses):
        duration[: len(course.duration), k] = course.duration
        effort[: len(course.duration), k] = course.effort
    trail = [state]
    left = np.full(len(courses), steps + 1)
    joint = np.zeros(len(courses), dtype=np.int64)
    for k in range(steps):
        after = advance(physics, state, effort[k], duration[k])
        outside = ~np.isfinite(after.q) | ~np.isfinite(after.v) | (after.q < ranges[0]) | (after.q > ranges[1])
        diverging = np.any(outside, axis=1) & (left > steps)
        left[diverging], joint[diverging] = k + 1, np.argmax(outside[diverging], axis=1)
        state = _held(state, after, left <= steps)
        trail.append(state)
    q, v = np.stack([moment.q for moment in trail]), np.stack([moment.v for moment in trail])
    memory = None if state.memory is None else np.stack([m.memory for m in trail if m.memory is not None])
    result = []
    for k, course in enumerate(courses):
        at = course.marks
        own = State(q[at, k], v[at, k], None if memory is None else memory[at, k])
        first_lost = int(np.searchsorted(at, left[k])) if left[k] <= at[-1] else None
        result.append(_Simulated(own, first_lost, int(joint[k])))
    return result


def _held(before: State, after: State, lost: Flags) -> State:
    """The state after a step; of simulations that are `lost` (B,), the positions before it, at rest."""
    if not np.any(lost):
        return after
    rows = lost[:, None]
    memory = after.memory
    if memory is not None and before.memory is not None:
        memory = np.where(rows, before.memory, memory)
    return State(np.where(rows, before.q, after.q), np.where(rows, 0.0, after.v), memory)


def root_mean_square(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """By column, over all windows of all recordings, of the samples before a simulation diverges; NaN where none is."""
    result = {}
    for column in forecasts[0].predicted:
        errors = np.concatenate([(f.predicted[column] - f.measured[column])[f.counted] for f in forecasts])
        result[column] = float("nan") if np.all(np.isnan(errors)) else float(np.sqrt(np.nanmean(errors**2)))
    return result


def divergence(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """By joint, s after which a simulation first leaves its range, over all windows of all recordings."""
    earliest: dict[str, float] = {}
    for simulated in forecasts:
        for joint, seconds in simulated.diverges.items():
            earliest[joint] = min(seconds, earliest.get(joint, np.inf))
    return earliest


def window_starts(time: Array, horizon: float) -> list[int]:
    """Indices at which windows begin, one horizon apart, after the first look back; one window if it is short."""
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first + 1e-9) / horizon))
    # in a gap many windows would begin with the sample after it: one is enough
    own = np.flatnonzero(time >= first - 1e-9)
    window = np.minimum(np.floor((time[own] - first + 1e-9) / horizon), count - 1)
    return [int(start) for start in own[np.flatnonzero(np.diff(window, prepend=-1.0) > 0.0)]]


def _gather(weak: WeakForm, physics: Physics, courses: Sequence[_Course], windows: Sequence[_Simulated]) -> Forecast:
    """Predicted and measured columns of all windows, end to end; sensor effects are put back into the prediction."""
    samples, names = weak.samples, physics.tree.joint_names
    states = [simulated.state for simulated in windows]
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
    measured = {name: columns[name][index] for name in predicted}
    lost, diverges = _divergence(samples.time, names, courses, windows)
    return Forecast(samples.recording.name, time, window, predicted, measured, lost, diverges)


def _divergence(
    time: Array, names: Sequence[str], courses: Sequence[_Course], windows: Sequence[_Simulated]
) -> tuple[Flags | None, dict[str, float]]:
    """`Forecast.lost` and `Forecast.diverges`."""
    lost: list[Flags] = []
    diverges: dict[str, float] = {}
    for course, simulated in zip(courses, windows, strict=True):
        own = np.zeros(course.stop - course.start + 1, dtype=bool)
        if simulated.first_lost is not None:
            own[simulated.first_lost :] = True
            name = names[simulated.joint]
            seconds = float(time[course.start + simulated.first_lost] - time[course.start])
            diverges[name] = min(seconds, diverges.get(name, np.inf))
        lost.append(own)
    together = np.concatenate(lost)
    return (together if np.any(together) else None), diverges
