"""Smooth motions within a robot's limits, parametrized by the control points of a spline.

A motion is a uniform cubic B-spline: its positions stay between those of its control points and its velocities between
their differences (de Boor, A Practical Guide to Splines, 1978, ch. IX), so that limits on both are satisfied exactly.
It starts and ends at rest at home, so that it can be repeated.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from drake_cafim.discrimination.servo_commands import commands_for
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.errors import InputError
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

RANGE, LINEAR_RANGE = 0.5 * np.pi, 0.1
"""rad and m: assumed range, to either side of zero, of a joint without position limits."""
SPEED, LINEAR_SPEED = 2.0, 0.25
"""rad/s and m/s: assumed limit of a joint without a velocity limit."""
MARGIN = 0.9
"""Fraction of each limit that a plan uses; the rest is a reserve for the feedback controller."""
SHRINK, SHRINKINGS = 0.8, 12
"""Factor by which a motion is scaled towards home while its efforts exceed the limits, and how often at most."""
AT_REST = 3
"""Number of equal control points at either end for which a cubic spline is at rest there."""


@dataclass(frozen=True)
class Limits:
    """Limits of planned motions: `home`, `lower`, `upper` (n,) rad or m, `speed` (n,) rad/s or m/s, `effort` (n,) N m
    or N.
    """

    home: Array
    lower: Array
    upper: Array
    speed: Array
    effort: Array

    @classmethod
    def of(cls, tree: Tree) -> "Limits":
        """90 % of the model file's limits; home is zero, or the middle of the range where zero is outside.

        A joint whose file states no effort limit, or 0, has none.
        """
        bounds = []
        for joint in tree.joints:
            reach = LINEAR_RANGE if joint.prismatic else RANGE
            lower, upper = joint.position_limits
            bounds.append((lower if np.isfinite(lower) else -reach, upper if np.isfinite(upper) else reach))
        lower, upper = np.array(bounds).T
        middle, half = 0.5 * (lower + upper), 0.5 * MARGIN * (upper - lower)
        lower, upper = middle - half, middle + half
        given = np.array([joint.velocity_limit for joint in tree.joints])
        usual = np.array([LINEAR_SPEED if joint.prismatic else SPEED for joint in tree.joints])
        return cls(
            home=np.where((lower < 0.0) & (upper > 0.0), 0.0, middle),
            lower=lower,
            upper=upper,
            speed=MARGIN * np.where(np.isfinite(given) & (given > 0.0), given, usual),
            effort=MARGIN * np.array([joint.effort_limit or np.inf for joint in tree.joints]),
        )


@dataclass(frozen=True)
class Motion:
    """A motion at `time` (T,) s: `q`, `v` and efforts `u` (T, n); of a planned one, by the nominal inverse dynamics.

    `u` is constant from its sample to the next.
    """

    time: Array
    q: Array
    v: Array
    u: Array
    cmd: Array | None = None
    """(T, n) commands of position servos, rad or m, NaN at joints without one; None where no servo drives."""


@dataclass(frozen=True)
class Shape:
    """The parametrization of all compared motions: `points` free control points, `spacing` s apart, sampled every
    `step` s.
    """

    points: int = 22
    spacing: float = 0.08
    step: float = 0.004

    @classmethod
    def lasting(cls, duration: float) -> "Shape":
        """The shape of motions that last about `duration` s, to within half a `spacing`."""
        return cls(points=max(round(duration / cls.spacing) + 3 - 2 * AT_REST, 4))

    @property
    def duration(self) -> float:
        """Duration of the motions, s."""
        return self.spacing * (self.points + 2 * AT_REST - 3)

    @cached_property
    def time(self) -> Array:
        """Sample times (T,) s, from 0."""
        return np.asarray(self.step * np.arange(round(self.duration / self.step) + 1), dtype=float)

    def matrix(self, at: Array, derivative: int) -> Array:
        """Matrix (T, points + 6) from control points to the spline's value or derivative at `at` (T,) s."""
        count = self.points + 2 * AT_REST
        knots = np.asarray(self.spacing * (np.arange(count + 4) - 3), dtype=float)
        spline = BSpline(knots, np.eye(count), 3)
        inside = np.clip(at, 0.0, self.duration - 1e-12)
        return np.asarray(spline(inside, nu=derivative), dtype=float)

    @cached_property
    def at_samples(self) -> tuple[Array, Array]:
        """Matrices from control points to value and velocity at the samples."""
        return self.matrix(self.time, 0), self.matrix(self.time, 1)

    @cached_property
    def between_samples(self) -> tuple[Array, Array, Array]:
        """Matrices from control points to value, velocity and acceleration half a step after each sample.

        An effort that is constant over a step is best computed at the step's middle.
        """
        middle = self.time + 0.5 * self.step
        return self.matrix(middle, 0), self.matrix(middle, 1), self.matrix(middle, 2)


def control_points(shape: Shape, limits: Limits, commands: Array) -> Array:
    """Control points (points + 6, n) from `commands` (points, n), where [−1, 1] is each joint's range.

    Each point is clipped to what the speed limit allows from its predecessor and back home in time.
    """
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    wanted = middle + half * commands
    most = limits.speed * shape.spacing
    points = np.empty_like(wanted)
    before = limits.home
    for k in range(shape.points):
        back = most * (shape.points - k)
        lower = np.maximum(before - most, limits.home - back)
        upper = np.minimum(before + most, limits.home + back)
        points[k] = before = np.clip(wanted[k], lower, upper)
    rest = np.repeat(limits.home[None], AT_REST, axis=0)
    return np.concatenate([rest, points, rest])


def plan(shape: Shape, limits: Limits, physics: Physics, commands: Array) -> Motion:
    """The motion of `commands` (points, n), scaled towards home until its efforts are within the limits.

    Raises `InputError` where the efforts still exceed the limits after `SHRINKINGS` reductions.
    """
    points = control_points(shape, limits, commands)
    for _ in range(SHRINKINGS):
        found = motion_through(shape, physics, points)
        if np.all(np.abs(found.u) <= limits.effort):
            return found
        points = limits.home + SHRINK * (points - limits.home)
    worst = int(np.argmax(np.max(np.abs(found.u), axis=0) / limits.effort))
    joint = physics.tree.joints[worst]
    raise InputError(
        f"the robot cannot move about {np.round(limits.home, 3).tolist()}: joint {joint.name} needs "
        f"{np.max(np.abs(found.u[:, worst])):.3g} {joint.effort_unit}, its limit is {joint.effort_limit:.3g}"
    )


def motion_through(shape: Shape, physics: Physics, points: Array) -> Motion:
    """The motion of control points (points + 6, n), without regard to the effort limits."""
    value, rate = shape.at_samples
    q, v, a = (matrix @ points for matrix in shape.between_samples)
    u = inverse_dynamics(physics, shape.time, q, v, a)
    cmd = commands_for(physics, q, v, u) if physics.servos else None
    return Motion(shape.time, value @ points, rate @ points, u, cmd)


def inverse_dynamics(physics: Physics, time: Array, q: Array, v: Array, a: Array) -> Array:
    """Inverse dynamics: the efforts (T, n) for accelerations `a` (T, n), including contacts, body and joint forces."""
    moving = motion(physics.tree, q, v)
    M, bias = equations_of_motion(moving, physics.gravity)
    effort = np.einsum("nij,nj->ni", M + np.diag(physics.rotor_inertias), a) + bias
    if physics.contacts:
        memory = physics.contact_memory(time, moving, moving)
        effort = effort - moving.project(physics.contact_wrenches(moving, memory))
    if physics.body_forces:
        effort = effort - moving.project(physics.body_wrenches(moving))
    joints = [JointSamples(q[:, j], v[:, j], effort[:, j]) for j in range(q.shape[1])]
    return np.asarray(effort - physics.applied_at_joints(joints)[0])
