"""One recording's steps and readings, linearised about a trajectory: what the smoother of `smoother` takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.likelihood.flow import Intervals, flow, steps_of
from drake_cafim.diagnosis.likelihood.smoother import filter_forward, smooth
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

STATE_STEP, EFFORT_STEP = 1e-6, 1e-3
"""Finite differences: rad and rad/s (m and m/s); N m (N)."""
FREE_POSITION, FREE_VELOCITY = 10.0, 100.0
"""Standard deviations of an initial state of which nothing is known, rad and rad/s (m and m/s)."""


@dataclass(frozen=True)
class Readings:
    """What a recording holds: `values` (N, m) with `seen` (N, m) where they were recorded, and `std` (m,)."""

    values: Array
    seen: Flags
    std: Array


@dataclass(frozen=True)
class Displaced:
    """The physics with one parameter displaced by `size`, for a difference quotient."""

    physics: Physics
    size: float


@dataclass(frozen=True)
class Pass:
    """What one filter pass over a recording says; see `filter_forward`."""

    information: Array
    gradient: Array
    scores: Array
    chi_square: float
    log_volume: float
    means: Array
    covariances: Array
    gains: Array


@dataclass(frozen=True)
class Linearised:
    """A recording's steps x₊ = A x + B θ + c + E w and readings r = C x + D θ + e about a trajectory, see `smoother`."""

    A: Array
    B: Array
    c: Array
    E: Array
    C: Array
    D: Array
    r: Array
    R: Array
    seen: Flags
    start: Array

    @cached_property
    def filtered(self) -> Pass:
        """The filter's pass."""
        found = filter_forward(
            self.A, self.B, self.c, self.E, self.C, self.D, self.r, self.R, self.seen, self.start
        )
        return Pass(*found[:4], float(found[4][0]), *found[5:])

    def deviations(self, theta: Array) -> Array:
        """(N, s) smoothed deviations of the states for parameters that deviate by `theta` (p,)."""
        done = self.filtered
        return np.asarray(
            smooth(
                self.A, self.C, self.D, self.r, self.R, self.seen, theta, done.means, done.covariances, done.gains,
                self.c, self.B, self.E, self.start,
            )
        )  # fmt: skip


def readings(weak: WeakForm, physics: Physics) -> Readings:
    """The recording's positions, velocities where measured, and wrenches, corrected for the sensor effects."""
    samples, measured = weak.samples, weak.measurement(physics)
    names, columns = physics.tree.joint_names, samples.recording.columns
    kinds = ("q", "v") if samples.velocity_measured else ("q",)
    recorded = [f"{kind}.{name}" for kind in kinds for name in names]
    values = [measured.q, measured.v] if samples.velocity_measured else [measured.q]
    for sensor, wrench in zip(weak.sensors, measured.wrenches, strict=True):
        recorded += [f"wrench.{sensor.name}.{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]
        values.append(wrench)
    seen = np.stack([np.isfinite(columns[name]) for name in recorded], axis=1)
    return Readings(np.concatenate(values, axis=1), seen, np.array([samples.std[name] for name in recorded]))


def predicted(weak: WeakForm, physics: Physics, state: Array) -> Array:
    """The readings (N, m) that `physics` predicts at states (N, 2n)."""
    n = state.shape[1] // 2
    parts = [state] if weak.samples.velocity_measured else [state[:, :n]]
    if weak.sensors:
        moving = motion(physics.tree, state[:, :n], state[:, n:])
        wrenches = physics.contact_wrenches(moving)
        parts += [sensor.reading(moving, wrenches[:, sensor.joint]) for sensor in weak.sensors]
    return np.concatenate(parts, axis=1)


def efforts(weak: WeakForm, physics: Physics) -> tuple[Array, Array]:
    """The efforts (N−1, n) that act at the start and at the end of each interval."""
    mean = weak.mean_effort(physics)[:-1]
    first, last = mean.copy(), mean.copy()
    driven = {physics.tree.joint_index(effect.at) for effect in physics.actuators}
    u = weak.measurement(physics).u
    for j in np.flatnonzero(weak.samples.ramped):
        if j not in driven:
            first[:, j], last[:, j] = u[:-1, j], u[1:, j]
    return first, last


def intervals_of(weak: WeakForm, physics: Physics) -> Intervals:
    """The recording's sampling intervals with the efforts that act in them."""
    time = weak.samples.time
    return Intervals(time[:-1], np.diff(time), *efforts(weak, physics), weak.samples.recording.name)


def linearise(weak: WeakForm, physics: Physics, displaced: Sequence[Displaced], state: Array) -> Linearised:
    """The recording about the trajectory `state` (N, 2n), with the parameters of `displaced` as θ."""
    N, n = len(state), state.shape[1] // 2
    begin, intervals = state[:-1], intervals_of(weak, physics)
    steps = steps_of(physics, begin, state[1:], intervals)
    after = flow(physics, begin, intervals, steps)

    def slope(moved: Array, size: float) -> Array:
        return np.asarray((moved - after) / size)

    A = np.stack(
        [slope(flow(physics, begin + push, intervals, steps), STATE_STEP) for push in STATE_STEP * np.eye(2 * n)],
        axis=2,
    )
    columns = []
    for other in displaced:
        moved = flow(other.physics, begin, intervals_of(weak, other.physics), steps)
        columns.append(slope(moved, other.size))
    B = np.stack(columns, axis=2) if columns else np.zeros((N - 1, 2 * n, 0))
    read = readings(weak, physics)
    expected = predicted(weak, physics, state)
    C, D = _slopes_of_readings(weak, physics, displaced, state, read, expected)
    start = np.repeat(np.square([FREE_POSITION, FREE_VELOCITY]), n)
    found = Linearised(
        A, B, after - state[1:], np.zeros((N - 1, 2 * n, 0)), C, D, read.values - expected, read.std**2, read.seen, start
    )
    return _with_noise_of_efforts(found, weak, physics, intervals, begin, steps, after)


def _slopes_of_readings(
    weak: WeakForm, physics: Physics, displaced: Sequence[Displaced], state: Array, read: Readings, expected: Array
) -> tuple[Array, Array]:
    """C (N, m, 2n) and D (N, m, p); what changes the correction of readings counts as a change of the prediction."""
    N, m, states = len(state), expected.shape[1], state.shape[1]
    C = np.tile(np.eye(m, states), (N, 1, 1))
    if weak.sensors:
        # at contacts a fraction of a millimetre matters
        size = 1e-2 * STATE_STEP
        C = np.stack(
            [(predicted(weak, physics, state + push) - expected) / size for push in size * np.eye(states)], axis=2
        )
    D = np.zeros((N, m, len(displaced)))
    for i, other in enumerate(displaced):
        if weak.sensors:
            D[:, :, i] = (predicted(weak, other.physics, state) - expected) / other.size
        if other.physics.sensors:
            D[:, :, i] -= (readings(weak, other.physics).values - read.values) / other.size
    return C, D


def _with_noise_of_efforts(
    found: Linearised, weak: WeakForm, physics: Physics, intervals: Intervals, begin: Array, steps: Array, after: Array
) -> Linearised:
    """With the noise of measured efforts as process noise.

    The error of a held effort acts until the next sample. That of a ramped one acts before its sample and after it, so
    that it is a part of the state.
    """
    std = np.array([weak.samples.std[f"u.{name}"] for name in physics.tree.joint_names])
    if not np.any(std):
        return found
    N, states = len(begin) + 1, begin.shape[1]
    n = states // 2
    ramped = bool(np.any(weak.samples.ramped))

    def slopes(first: float, last: float) -> Array:
        columns = []
        for j in range(n):
            push = EFFORT_STEP * np.eye(n)[j]
            other = replace(intervals, first=intervals.first + first * push, last=intervals.last + last * push)
            columns.append((flow(physics, begin, other, steps) - after) / EFFORT_STEP * std[j])
        return np.stack(columns, axis=2)

    if not ramped:
        return replace(found, E=slopes(1.0, 1.0))
    now, then = slopes(1.0, 0.0), slopes(0.0, 1.0)
    A = np.zeros((N - 1, states + n, states + n))
    A[:, :states, :states], A[:, :states, states:] = found.A, now
    return replace(
        found,
        A=A,
        B=np.concatenate([found.B, np.zeros((N - 1, n, found.B.shape[2]))], axis=1),
        c=np.concatenate([found.c, np.zeros((N - 1, n))], axis=1),
        E=np.concatenate([then, np.tile(np.eye(n), (N - 1, 1, 1))], axis=1),
        C=np.concatenate([found.C, np.zeros((N, found.C.shape[1], n))], axis=2),
        start=np.concatenate([found.start, np.ones(n)]),
    )
