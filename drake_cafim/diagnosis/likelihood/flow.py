"""The states of a model one sampling interval later, for many intervals at once (classical Runge–Kutta method)."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

LONGEST_STEP, LONGEST_CONTACT_STEP = 5e-3, 5e-4
"""s, without and with contact."""
TOLERANCE, MOST_STEPS = 1e-7, 64
"""Change of the end of an interval by twice as many steps that counts as rounding, rad and rad/s (m and m/s), and the
most steps of one interval."""


@dataclass(frozen=True)
class Intervals:
    """B intervals: from `time` (B,) s for `duration` (B,) s, the effort going from `first` to `last` (B, n) N m (N)."""

    time: Array
    duration: Array
    first: Array
    last: Array
    recording: str | None = None

    def at(self, rows: Indices) -> "Intervals":
        """Those of the given rows."""
        return Intervals(self.time[rows], self.duration[rows], self.first[rows], self.last[rows], self.recording)


def flow(physics: Physics, state: Array, intervals: Intervals, steps: Indices) -> Array:
    """The state (q, v) (B, 2n) at the end of each interval, from `state` (B, 2n) in `steps` (B,) equal steps."""
    result = np.empty_like(state)
    for count in np.unique(steps):
        rows = np.flatnonzero(steps == count)
        result[rows] = _integrate(physics, state[rows], intervals.at(rows), int(count))
    return result


def steps_of(physics: Physics, state: Array, intervals: Intervals) -> Indices:
    """(B,) the number of steps in which each interval is integrated: twice as many change its end by rounding alone.

    A change of sign of friction needs many more than a smooth motion does.
    """
    touching = physics.contacts or any(force.stiff for force in physics.body_forces)
    longest = LONGEST_CONTACT_STEP if touching else LONGEST_STEP
    steps = np.maximum(1, np.ceil(intervals.duration / longest - 1e-6)).astype(np.int64)
    rows = np.arange(len(steps))
    end = flow(physics, state, intervals, steps)
    while len(rows):
        own = intervals.at(rows)
        finer = flow(physics, state[rows], own, 2 * steps[rows])
        off = np.max(np.abs(finer - end[rows]), axis=1)
        end[rows] = finer
        rows = rows[(off > TOLERANCE) & (steps[rows] < MOST_STEPS)]
        steps[rows] *= 2
    return steps


def _integrate(physics: Physics, state: Array, intervals: Intervals, count: int) -> Array:
    h = intervals.duration / count
    change = (intervals.last - intervals.first) / count
    ramped = bool(np.any(change))
    x, step = state, h[:, None]
    for k in range(count):
        before = intervals.first + k * change
        middle, after = (before + 0.5 * change, before + change) if ramped else (before, before)
        time = intervals.time + k * h
        k1 = rates(physics, x, before, time, intervals.recording)
        k2 = rates(physics, x + 0.5 * step * k1, middle, time + 0.5 * h, intervals.recording)
        k3 = rates(physics, x + 0.5 * step * k2, middle, time + 0.5 * h, intervals.recording)
        k4 = rates(physics, x + step * k3, after, time + h, intervals.recording)
        x = x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return x


def rates(physics: Physics, state: Array, effort: Array, time: Array, recording: str | None) -> Array:
    """(q̇, v̇) (B, 2n) under the acting `effort` (B, n): M v̇ = u + f − c + Jᵀ F, see `stepper.step`."""
    n = state.shape[1] // 2
    q, v = state[:, :n], state[:, n:]
    moving = motion(physics.tree, q, v)
    M, bias = equations_of_motion(moving, physics.gravity)
    diagonal = np.arange(n)
    M[:, diagonal, diagonal] += physics.rotor_inertias
    force = effort - bias - physics.dampings * v
    for effect in physics.joint_forces:
        j = physics.tree.joint_index(effect.at)
        force[:, j] += effect.force(_samples(q, v, effort, j)).value
    if physics.contacts:
        force = force + moving.project(physics.contact_wrenches(moving))
    if physics.body_forces:
        force = force + moving.project(physics.body_wrenches(moving, time, recording))
    return np.concatenate([v, np.linalg.solve(M, force[..., None])[..., 0]], axis=1)


def _samples(q: Array, v: Array, u: Array, joint: int) -> JointSamples:
    return JointSamples(q[:, joint], v[:, joint], u[:, joint])


def unsupported(physics: Physics) -> str:
    """Why positions and velocities alone do not make up the model's state; empty where they do."""
    if physics.couplings:
        return "a rotor moves apart from its link"
    if any(contact.memory for contact in physics.contacts):
        return "a contact force depends on the past"
    if physics.bristles:
        return "a friction depends on the past"
    if physics.depends_on_load:
        return "a friction depends on the load from outside"
    return ""
