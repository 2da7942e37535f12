"""Simulation of a recording over windows of 1 s or 0.1 s, compared with the recorded samples.

It is open loop in the efforts, and closed through the position servos that drive joints, from their commands.

A simulation counts as long as every joint stays in its range. When a joint leaves its range the simulation has
diverged: its state is held from then on, and no later sample of that window counts, nor of the same window simulated
by a model that it is compared with: an error that grows with time would be the larger the longer a model holds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.predict.servo_input import ServoInput, goals_of, servo_input, stacked
from drake_cafim.diagnosis.predict.servo_memory import ServoMemory, remembering
from drake_cafim.diagnosis.predict.stepper import LONGEST_STEP, State, acting_efforts, advance
from drake_cafim.diagnosis.rows.weak_form import WeakForm, memory_of
from drake_cafim.dynamics.motion import motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

HORIZON, SHORT_HORIZON = 1.0, 0.1
"""Lengths of a window for `rmse` and for `rmse_short`, s."""
BOUNDLESS = 1e3
"""rad (m): a position limit of a model file that is at least this large is treated as no limit."""


@dataclass(frozen=True)
class Forecast:
    """One recording simulated window after window.

    `time` (K,) s and `window` (K,), the index of the window of each sample; `predicted` and `measured` hold the values
    (K,) of each column in that column's unit.
    """

    recording: str
    time: Array
    window: np.ndarray[tuple[int], np.dtype[np.int64]]
    predicted: dict[str, Array]
    measured: dict[str, Array]
    lost: Flags | None = None
    """(K,) samples after a joint left its range, which do not count; None where there are none."""
    diverges: Mapping[str, float] = field(default_factory=dict)
    """By joint, the shortest time, s, from a window's start until that joint left its range."""

    @property
    def counted(self) -> Flags:
        """(K,) samples of simulations that have not diverged."""
        return np.ones(len(self.time), dtype=bool) if self.lost is None else ~self.lost

    def beginning_within(self, begin: float, end: float) -> "Forecast | None":
        """The windows that begin from `begin` to before `end`, s; None where there is none."""
        firsts = {int(w): float(self.time[np.argmax(self.window == w)]) for w in np.unique(self.window)}
        kept = np.isin(self.window, [w for w, first in firsts.items() if begin <= first < end])
        if not np.any(kept):
            return None
        columns = [{name: values[kept] for name, values in group.items()} for group in (self.predicted, self.measured)]
        lost = None if self.lost is None else self.lost[kept]
        return replace(
            self, time=self.time[kept], window=self.window[kept], predicted=columns[0], measured=columns[1], lost=lost
        )


def forecast(weak: WeakForm, physics: Physics, horizon: float = HORIZON) -> Forecast:
    """The recording simulated in windows of `horizon` s, each from the state of the 50 ms before it."""
    return forecasts([weak], physics, horizon)[0]


def forecasts(forms: Sequence[WeakForm], physics: Physics, horizon: float = HORIZON) -> list[Forecast]:
    """The `forecast` of each recording; the windows of all recordings are simulated as one batch."""
    return simulated_courses(
        forms,
        physics,
        lambda weak: (window_starts(weak.samples.time, horizon), horizon),
        lambda weak, under, start: state_at(weak.samples, weak.measurement(under), start)[:2],
    )


def forecasts_within(
    forms: Sequence[WeakForm], physics: Physics, horizon: float, within: tuple[float, float]
) -> list[Forecast]:
    """The `forecast` of each recording over those windows that begin `within`, s, the end not included.

    A recording in which no window does is left out.
    """

    def starts(weak: WeakForm) -> list[int]:
        time = weak.samples.time
        return [start for start in window_starts(time, horizon) if within[0] <= time[start] < within[1]]

    own = [weak for weak in forms if starts(weak)]
    if not own:
        return []
    return simulated_courses(
        own,
        physics,
        lambda weak: (starts(weak), horizon),
        lambda weak, under, start: state_at(weak.samples, weak.measurement(under), start)[:2],
    )


def simulated_courses(
    forms: Sequence[WeakForm],
    physics: Physics,
    windows: Callable[[WeakForm], tuple[Sequence[int], float]],
    first_state: Callable[[WeakForm, Physics, int], tuple[Array, Array]],
    longest: float = LONGEST_STEP,
) -> list[Forecast]:
    """Each recording simulated over its `windows`, all as one batch.

    `windows` gives the samples at which they start and their length, s; `first_state` q and v (n,) at one of these. No
    step is longer than `longest`, s.
    """
    courses, states = [], []
    for weak in forms:
        own = _courses(weak, physics, *windows(weak))
        memory = memory_of(weak, physics)
        courses.append(own)
        states += [(*first_state(weak, physics, course.start), memory[course.start]) for course in own]
    state = State(*(np.stack([parts[k] for parts in states]) for k in range(3)))
    together = [course for own in courses for course in own]
    begins = [(weak, course.start) for weak, own in zip(forms, courses, strict=True) for course in own]
    past = ServoMemory.of(begins, physics)
    trail = _simulate(physics, state, together, joint_ranges(forms, physics), past, longest)
    result, first = [], 0
    for weak, own in zip(forms, courses, strict=True):
        result.append(_gather(weak, physics, own, trail[first : first + len(own)]))
        first += len(own)
    return result


def joint_ranges(forms: Sequence[WeakForm], physics: Physics) -> Array:
    """The smallest and the largest position (2, n) of each joint, rad or m, that a simulation may reach.

    These are the model's position limits, widened to the recorded range. A joint without a limit gets its recorded
    range and 2π rad more (a prismatic joint: the recorded stroke more) on that side.
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
    """The inputs of one window, from sample `start` to sample `stop`.

    `effort` (K, n) is held over each of K intervals of `duration` (K,) s; `marks` (stop − start + 1,) is the number of
    intervals that lie before each sample.
    """

    start: int
    stop: int
    duration: Array
    effort: Array
    marks: np.ndarray[tuple[int], np.dtype[np.int64]]
    servo: ServoInput


def _courses(weak: WeakForm, physics: Physics, starts: Sequence[int], horizon: float) -> list[_Course]:
    """The inputs of each window of `horizon` s from the samples `starts` on.

    An interval ends at each sample and at each knot of the efforts.
    """
    time = weak.samples.time
    served = weak.samples.commands
    knots, efforts = acting_efforts(physics, time, weak.measurement(physics).u, weak.samples.ramped, served)
    # what is followed of a command that is late or filtered changes within the intervals
    fine = bool(remembering(physics)) or any(effect.remembers for effect in physics.servo_effects)
    taken, goals = rotor_efforts(weak, physics), goals_of(weak, physics)
    result = []
    for start in starts:
        stop = int(np.searchsorted(time, time[start] + horizon + 1e-9, side="right")) - 1
        own = time[start : stop + 1]
        within = knots[(knots > own[0] + 1e-12) & (knots < own[-1] - 1e-12)]
        edges = np.unique(np.concatenate([own, within]))
        if fine:
            parts = max(1, int(np.ceil(float(np.max(np.diff(edges))) / LONGEST_STEP - 1e-6)))
            shares = np.arange(parts) / parts
            edges = np.append((edges[:-1, None] + np.diff(edges)[:, None] * shares).ravel(), edges[-1])
        held = np.clip(np.searchsorted(knots, edges[:-1] + 1e-12, side="right") - 1, 0, None)
        rotors = taken[np.searchsorted(time, edges[:-1] + 1e-12, side="right") - 1]
        servo = servo_input(weak, physics, goals, edges)
        result.append(_Course(start, stop, np.diff(edges), efforts[held] + rotors, np.searchsorted(edges, own), servo))
    return result


@dataclass(frozen=True)
class _Simulated:
    """One simulated window: states (K, n) at its samples; the sample and the joint at which it diverged, if it did."""

    state: State
    first_lost: int | None
    joint: int


def _simulate(
    physics: Physics,
    state: State,
    courses: Sequence[_Course],
    ranges: Array,
    memory: ServoMemory | None,
    longest: float,
) -> list[_Simulated]:
    """The states of each course at its samples, held from the step at which a joint leaves `ranges` (2, n)."""
    steps = max(len(course.duration) for course in courses)
    duration = np.zeros((steps, len(courses)))
    effort = np.zeros((steps, *state.q.shape))
    for k, course in enumerate(courses):
        duration[: len(course.duration), k] = course.duration
        effort[: len(course.duration), k] = course.effort
    driving = any(np.any(course.servo.on) for course in courses)
    servo = stacked([course.servo.padded(steps) for course in courses]) if driving else [None] * steps
    trail = [state]
    left = np.full(len(courses), steps + 1)
    joint = np.zeros(len(courses), dtype=np.int64)
    for k in range(steps):
        asked = servo[k]
        if memory is not None and asked is not None:
            asked, acting = memory.drive(physics, asked, state.q, state.v, duration[k])
            effort[k] += acting
        after = advance(physics, state, effort[k], duration[k], asked, longest)
        outside = ~np.isfinite(after.q) | ~np.isfinite(after.v) | (after.q < ranges[0]) | (after.q > ranges[1])
        diverging = np.any(outside, axis=1) & (left > steps)
        left[diverging], joint[diverging] = k + 1, np.argmax(outside[diverging], axis=1)
        state = _hold(state, after, left <= steps)
        trail.append(state)
    q, v = np.stack([moment.q for moment in trail]), np.stack([moment.v for moment in trail])
    states = None if state.memory is None else np.stack([m.memory for m in trail if m.memory is not None])
    result = []
    for k, course in enumerate(courses):
        at = course.marks
        own = State(q[at, k], v[at, k], None if states is None else states[at, k])
        first_lost = int(np.searchsorted(at, left[k])) if left[k] <= at[-1] else None
        result.append(_Simulated(own, first_lost, int(joint[k])))
    return result


def _hold(before: State, after: State, lost: Flags) -> State:
    """The state `after` a step; for simulations that are `lost` (B,), the position `before` it and zero velocity."""
    if not np.any(lost):
        return after
    rows = lost[:, None]
    memory = after.memory
    if memory is not None and before.memory is not None:
        memory = np.where(rows, before.memory, memory)
    return State(np.where(rows, before.q, after.q), np.where(rows, 0.0, after.v), memory)


def root_mean_square(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """√mean((predicted − measured)²) by column over all windows, up to where they diverge; NaN without any sample."""
    result = {}
    for column in forecasts[0].predicted:
        errors = np.concatenate([(f.predicted[column] - f.measured[column])[f.counted] for f in forecasts])
        result[column] = float("nan") if np.all(np.isnan(errors)) else float(np.sqrt(np.nanmean(errors**2)))
    return result


def counted_together(by_model: Sequence[Sequence[Forecast]]) -> list[Sequence[Forecast]]:
    """The forecasts of the same recordings by several models, of which those samples count that count for all."""
    common = [np.logical_and.reduce([own.counted for own in each]) for each in zip(*by_model, strict=True)]
    return [
        [own if np.all(kept) else replace(own, lost=~kept) for own, kept in zip(each, common, strict=True)]
        for each in by_model
    ]


def divergence(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """By joint, the shortest time, s, after which a window of any recording leaves its range."""
    earliest: dict[str, float] = {}
    for simulated in forecasts:
        for joint, seconds in simulated.diverges.items():
            earliest[joint] = min(seconds, earliest.get(joint, np.inf))
    return earliest


def window_starts(time: Array, horizon: float) -> list[int]:
    """Sample indices at which windows begin, one `horizon` apart; a recording shorter than that has one window.

    The first begins `LOOK_BACK` s after the first sample, since its initial state is estimated from those samples.
    """
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first + 1e-9) / horizon))
    # all windows that would begin within a gap share the first sample after it: only one of them is kept
    own = np.flatnonzero(time >= first - 1e-9)
    window = np.minimum(np.floor((time[own] - first + 1e-9) / horizon), count - 1)
    return [int(start) for start in own[np.flatnonzero(np.diff(window, prepend=-1.0) > 0.0)]]


def _gather(weak: WeakForm, physics: Physics, courses: Sequence[_Course], windows: Sequence[_Simulated]) -> Forecast:
    """The windows' predicted and measured columns, concatenated; sensor effects are applied to the prediction."""
    samples, names = weak.samples, physics.tree.joint_names
    states = [simulated.state for simulated in windows]
    index = np.concatenate([np.arange(course.start, course.stop + 1) for course in courses])
    window = np.concatenate([np.full(course.stop - course.start + 1, w) for w, course in enumerate(courses)])
    q_flat, v_flat = np.concatenate([state.q for state in states]), np.concatenate([state.v for state in states])
    predicted = {f"q.{name}": q_flat[:, j].copy() for j, name in enumerate(names)}
    if samples.velocity_measured:
        predicted |= {f"v.{name}": v_flat[:, j].copy() for j, name in enumerate(names)}
    if weak.sensors:
        moving = motion(physics.tree, q_flat, v_flat)
        memory = [state.memory for state in states if state.memory is not None]
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
            distorted = effect.measured(time[rows], np.stack([predicted[name][rows] for name in on], axis=1))
            for k, name in enumerate(on):
                predicted[name][rows] = distorted[:, k]
    columns = samples.recording.columns
    measured = {name: columns[name][index] for name in predicted}
    lost, diverges = _divergence(samples.time, names, courses, windows)
    return Forecast(samples.recording.name, time, window, predicted, measured, lost, diverges)


def _divergence(
    time: Array, names: Sequence[str], courses: Sequence[_Course], windows: Sequence[_Simulated]
) -> tuple[Flags | None, dict[str, float]]:
    """The fields `lost` and `diverges` of a `Forecast`."""
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
