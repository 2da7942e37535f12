"""One recording's steps and readings, linearised about a trajectory: what the smoother of `smoother` takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.likelihood.flow import Intervals, steps_of
from drake_cafim.diagnosis.likelihood.smoother import filter_forward, smooth
from drake_cafim.diagnosis.likelihood.transitions import Displaced, Transitions, transitions
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import bias_force, motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

READING_STEP = 1e-8
"""Finite differences of readings, rad and rad/s (m and m/s): at contacts a fraction of a millimetre matters."""
FREE_POSITION, FREE_VELOCITY = 10.0, 100.0
"""Standard deviations of an initial state of which nothing is known, rad and rad/s (m and m/s)."""


@dataclass(frozen=True)
class Readings:
    """What a recording holds: `values` (N, m) with `seen` (N, m) where they were recorded, and `std` (m,)."""

    values: Array
    seen: Flags
    std: Array


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
    """Steps x₊ = A x + B θ + c + E w and readings r = C x + D θ + e of one recording, see `smoother`."""

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
        found = filter_forward(self.A, self.B, self.c, self.E, self.C, self.D, self.r, self.R, self.seen, self.start)
        information, gradient, scores, chi_square, log_volume, means, covariances, gains = found
        return Pass(information, gradient, scores, float(chi_square), float(log_volume), means, covariances, gains)

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


def linearise(
    weak: WeakForm, physics: Physics, others: Sequence[tuple[Physics, float]], state: Array, freedom: float = 0.0
) -> Linearised:
    """The recording about the trajectory `state` (N, 2n); `others`: physics with a parameter displaced, by how much.

    With a `freedom`, forces of this share of each joint's own, anew in each interval, act beside the model's.
    """
    N, n = len(state), state.shape[1] // 2
    intervals = intervals_of(weak, physics)
    steps = steps_of(physics, state[:-1], intervals)
    displaced = [Displaced(other, size, intervals_of(weak, other)) for other, size in others]
    found = transitions(physics, displaced, state[:-1], intervals, steps)
    read, expected = readings(weak, physics), predicted(weak, physics, state)
    C, D = _slopes_of_readings(weak, physics, displaced, state, read, expected)
    start = np.repeat(np.square([FREE_POSITION, FREE_VELOCITY]), n)
    plain = Linearised(
        found.by_state,
        found.by_parameters,
        found.after - state[1:],
        np.zeros((N - 1, 2 * n, 0)),
        C,
        D,
        read.values - expected,
        read.std**2,
        read.seen,
        start,
    )
    std = np.array([weak.samples.std[f"u.{name}"] for name in physics.tree.joint_names])
    if freedom:
        std = np.hypot(std, freedom * _sizes_of_forces(physics, state[:-1], intervals))
    return _with_noise_of_efforts(plain, found, std, bool(np.any(weak.samples.ramped))) if np.any(std) else plain


def _sizes_of_forces(physics: Physics, state: Array, intervals: Intervals) -> Array:
    """(n,) root mean squares of the efforts and of gravity and Coriolis forces together, N m (N)."""
    n = state.shape[1] // 2
    bias = bias_force(motion(physics.tree, state[:, :n], state[:, n:]), physics.gravity)
    return np.asarray(np.sqrt(np.mean(intervals.first**2 + bias**2, axis=0)))


def _slopes_of_readings(
    weak: WeakForm, physics: Physics, displaced: Sequence[Displaced], state: Array, read: Readings, expected: Array
) -> tuple[Array, Array]:
    """C (N, m, 2n) and D (N, m, p); what changes the correction of readings counts as a change of the prediction."""
    N, m, states = len(state), expected.shape[1], state.shape[1]
    C = np.tile(np.eye(m, states), (N, 1, 1))
    if weak.sensors:
        pushes = READING_STEP * np.eye(states)
        C = np.stack([(predicted(weak, physics, state + e) - expected) / READING_STEP for e in pushes], axis=2)
    D = np.zeros((N, m, len(displaced)))
    for i, other in enumerate(displaced):
        if weak.sensors:
            D[:, :, i] = (predicted(weak, other.physics, state) - expected) / other.size
        if other.physics.sensors:
            D[:, :, i] -= (readings(weak, other.physics).values - read.values) / other.size
    return C, D


def _with_noise_of_efforts(plain: Linearised, found: Transitions, std: Array, ramped: bool) -> Linearised:
    """With the noise of measured efforts, of `std` (n,), as process noise.

    The error of a held effort acts until the next sample. That of a ramped one acts before its sample and after it, so
    that it is a part of the state.
    """
    if not ramped:
        return replace(plain, E=(found.by_first + found.by_last) * std)
    steps, states, n = found.by_first.shape
    A = np.zeros((steps, states + n, states + n))
    A[:, :states, :states], A[:, :states, states:] = plain.A, found.by_first * std
    return replace(
        plain,
        A=A,
        B=np.concatenate([plain.B, np.zeros((steps, n, plain.B.shape[2]))], axis=1),
        c=np.concatenate([plain.c, np.zeros((steps, n))], axis=1),
        E=np.concatenate([found.by_last * std, np.tile(np.eye(n), (steps, 1, 1))], axis=1),
        C=np.concatenate([plain.C, np.zeros((steps + 1, plain.C.shape[1], n))], axis=2),
        start=np.concatenate([plain.start, np.ones(n)]),
    )
