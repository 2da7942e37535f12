"""Contact of a sphere on the tree with a fixed plane: kinematics and wrench; and wrench sensors."""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.contact.change import ContactChange, Touch, surface_axes
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NORMAL_LAWS
from drake_cafim.dynamics.motion import Motion
from drake_cafim.dynamics.touching import sensor_reading, touch_kinematics
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SphereContact:
    """The contact of a sphere, fixed to a joint's moving frame, with a plane fixed in the world.

    `p_JC` (3,) m is the sphere's centre in frame J of `joint`; the plane passes through `point` (3,) m and has the
    outward unit `normal` (3,), world frame. `changes` are contact effects on its law.
    """

    bodies: tuple[str, str]
    joint: int
    p_JC: Array
    radius: float
    point: Array
    normal: Array
    law: ContactLaw
    parameters: ContactParameters
    changes: tuple[ContactChange, ...] = ()

    @property
    def name(self) -> str:
        """The two bodies' names, separated by a slash."""
        return "/".join(self.bodies)

    def with_parameter(self, name: str, value: float) -> "SphereContact":
        """The contact with one of its parameters replaced."""
        if name == "radius":
            return replace(self, radius=value, parameters=replace(self.parameters, radius=value))
        return replace(self, parameters=replace(self.parameters, **{name: value}))

    @property
    def flat(self) -> bool:
        """Whether the surface is a plane, with one normal."""
        return True

    @property
    def place(self) -> tuple[Array, ...]:
        """Where the surface is, as arrays."""
        return (self.point, self.normal)

    def raised(self, offset: float) -> "SphereContact":
        """The contact with its surface `offset` m farther out."""
        return replace(self, point=self.point + offset * self.normal)

    def outward(self, touch: Touch) -> Array:
        """The surface's outward normal (N, 3), or (1, 3) if it is constant, world axes."""
        return np.asarray(self.normal[None])

    @property
    def points(self) -> Array:
        """(K, 3) m in frame J: centres of the spheres that may touch; those of radius 0 are points."""
        return self.p_JC[None]

    def by_point(self) -> "tuple[SphereContact, ...]":
        """One contact, of a sphere or a point, for each of `points`."""
        return (self,)

    @cached_property
    def _axes(self) -> Array:
        """The plane's axes (3, 3), cached since the normal is constant."""
        return surface_axes(self.normal)

    @cached_property
    def _placed(self) -> tuple[Array, float, Array, Array]:
        """Centre, radius, point and normal, as contiguous arguments of compiled functions."""
        center, point, normal = (np.ascontiguousarray(a, dtype=float) for a in (self.p_JC, self.point, self.normal))
        return center, float(self.radius), point, normal

    @cached_property
    def numbers(self) -> tuple[Array, Array] | None:
        """Geometry (10,) and law (10,) as arguments of `sphere_wrenches`; None for other than a sphere without changes.

        The law is its kind, stiffness, damping or dissipation, smoothing, friction, kind and width of the friction,
        narrowing and deficit of the pressure field, and `lifted`.
        """
        if type(self) is not SphereContact or self.changes:
            return None
        values, kind = self.parameters, NORMAL_LAWS.index(self.law.normal)
        numbers = values.of_normal(self.law.normal)
        loss = values.dissipation if self.law.normal in ("hunt_crossley", "hydroelastic") else values.damping
        form, width = (1, values.slip_velocity) if values.slip_velocity is not None else (2, values.resistance)
        tangential = (0, 0.0) if width is None else (form, width)
        field = (numbers.get("narrowing", 1.0), numbers.get("deficit", 0.0))
        law = (kind, numbers["stiffness"], loss, self.law.smoothing, values.friction, *tangential, *field, self.lifted)
        if any(np.ndim(number) for number in law):
            return None
        center, radius, point, normal = self._placed
        return np.concatenate([center, [radius], point, normal]), np.array(law, dtype=float)

    @cached_property
    def _below(self) -> Array:
        """(1, 3) m, from the sphere's centre to its deepest point, world axes."""
        return np.asarray(-self.radius * self.normal[None])

    @property
    def lifted(self) -> float:
        """How far above the sphere's deepest point its force acts, in penetrations: 1 for a soft sphere, else 0.

        A plane presses a soft sphere flat, and the pressure acts where they meet; Drake's field has that surface.
        """
        given = self.parameters
        return float(self.law.normal == "hydroelastic" and given.radius == self.radius and given.half_extent == 0.0)

    @property
    def memory(self) -> int:
        """Total number m of the changes' internal states."""
        return sum(change.memory for change in self.changes)

    def changed(self, change: ContactChange) -> "SphereContact":
        """The contact with `change` appended."""
        return replace(self, changes=(*self.changes, change))

    def touch(self, moving: Motion) -> Touch:
        """The kinematics of the sphere's deepest point relative to the plane, over samples (N,)."""
        motion = (moving.R_WJ, moving.p_WJ, moving.velocities)
        depth, rate, slip, position, w_WJ = touch_kinematics(*motion, self.joint, *self._placed)
        return Touch(depth, rate, slip, position, w_WJ, self._below, self._axes)

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        """The changes' memory (N, m) at samples at `time` (N,) s; see `ContactChange.recall`."""
        return np.concatenate([change.recall(time, touch, at) for change in self.changes], axis=1)

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        """The memory (B, m) advanced by `elapsed` (B,) s; `touch` is the kinematics `left` (B,) s before the end."""
        parts = [change.ahead(part, touch, elapsed, left) for change, part in self._split(memory)]
        return np.concatenate(parts, axis=1)

    def force(self, touch: Touch, memory: Array | None = None) -> tuple[Array, Array]:
        """The force (N, 3) N on the sphere at the deepest point, and a moment (N, 3) N m beside it; world axes.

        Without `memory` (N, m) the changes' states are zero.
        """
        if memory is None:
            memory = np.zeros((len(touch.rate), self.memory))
        split = self._split(memory)
        added = sum(change.push(touch, self.parameters, part) for change, part in split)
        normal = self.law.normal_force(touch.penetration, touch.rate, self.parameters, added)
        tangential, moment = None, np.zeros_like(touch.slip)
        for change, part in split:
            found = change.traction(self.law, normal, touch, self.parameters, part)
            tangential = found if found is not None else tangential
            beside = change.moment(normal, touch)
            moment = moment if beside is None else moment + beside
        if tangential is None:
            tangential = self.law.tangential_force(normal, touch.slip, self.parameters)
        pulled = normal + sum(change.pull(touch) for change in self.changes)
        return pulled[:, None] * self.outward(touch) + tangential, moment

    def wrench(self, moving: Motion, memory: Array | None = None) -> Array:
        """The wrench (N, 6) on the joint's link about the world origin, moment first."""
        touch = self.touch(moving)
        force, moment = self.force(touch, memory)
        return np.concatenate([cross(self.pushed(touch), force) + moment, force], axis=1)

    def pushed(self, touch: Touch) -> Array:
        """The point (N, 3) m on which the force acts, world axes: the sphere's deepest, or higher (`lifted`)."""
        if not self.lifted:
            return touch.position
        return np.asarray(touch.position + (self.lifted * touch.penetration)[:, None] * self.outward(touch))

    def _split(self, memory: Array) -> list[tuple[ContactChange, Array]]:
        """Each change with its columns of the memory (N, m)."""
        ends = itertools.accumulate(change.memory for change in self.changes)
        return [(change, memory[:, end - change.memory : end]) for change, end in zip(self.changes, ends, strict=True)]


@dataclass(frozen=True)
class WrenchSensor:
    """A sensor of the wrench that contacts with the environment exert on its body, in and about its frame S."""

    name: str
    joint: int
    R_JS: Array
    p_JS: Array

    def reading(self, moving: Motion, wrench_W: Array) -> Array:
        """Force then torque (N, 6) in S about So, for a wrench (N, 6) about the world origin, moment first."""
        R_JS, p_JS, wrench = (np.ascontiguousarray(a, dtype=float) for a in (self.R_JS, self.p_JS, wrench_W))
        found = sensor_reading(moving.R_WJ, moving.p_WJ, self.joint, R_JS, p_JS, wrench)
        return np.asarray(found, dtype=float)
