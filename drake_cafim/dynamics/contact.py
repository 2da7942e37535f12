"""A sphere of the tree against a plane that stands still: where they touch, and the wrench that follows."""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.contact.change import ContactChange, Touch, surface_axes
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NORMAL_LAWS
from drake_cafim.cross import cross
from drake_cafim.dynamics.motion import Motion
from drake_cafim.dynamics.touching import met, read
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SphereContact:
    """The nominal contact of a sphere that rides a joint with a plane fixed in the world.

    `p_JC` (3,) m is the sphere's centre in frame J of `joint`; the plane passes through `point` with unit `normal`
    out of it, world frame. `changes` are what it does beyond its law.
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
        return "/".join(self.bodies)

    def with_parameter(self, name: str, value: float) -> "SphereContact":
        """The contact with one of its numbers replaced."""
        if name == "radius":
            return replace(self, radius=value)
        return replace(self, parameters=replace(self.parameters, **{name: value}))

    @property
    def points(self) -> Array:
        """(K, 3) m in frame J: centres of the spheres that may touch; those of radius 0 are points."""
        return self.p_JC[None]

    @cached_property
    def _axes(self) -> Array:
        """The plane's axes; of a normal that stands still they do, too."""
        return surface_axes(self.normal)

    @cached_property
    def _placed(self) -> tuple[Array, float, Array, Array]:
        """Centre, radius, point and normal, as compiled code takes them."""
        center, point, normal = (np.ascontiguousarray(a, dtype=float) for a in (self.p_JC, self.point, self.normal))
        return center, float(self.radius), point, normal

    @cached_property
    def numbers(self) -> tuple[Array, Array] | None:
        """Its place (10,) and its law (7,) as `pressed` takes them; None where it is more than one law of one sphere.

        The law is its kind, stiffness, damping or dissipation, smoothing, friction, and kind and width of the friction.
        """
        if type(self) is not SphereContact or self.changes:
            return None
        one, kind = self.parameters, NORMAL_LAWS.index(self.law.normal)
        loss = one.dissipation if self.law.normal == "hunt_crossley" else one.damping
        rubbing, width = (1, one.slip_velocity) if one.slip_velocity is not None else (2, one.resistance)
        rubs = (0, 0.0) if width is None else (rubbing, width)
        law = (kind, one.stiffness, loss, self.law.smoothing, one.friction, *rubs)
        if any(np.ndim(number) for number in law):
            return None
        center, radius, point, normal = self._placed
        return np.concatenate([center, [radius], point, normal]), np.array(law, dtype=float)

    @cached_property
    def _below(self) -> Array:
        """(1, 3) m, from the centre to the deepest point."""
        return np.asarray(-self.radius * self.normal[None])

    @property
    def memory(self) -> int:
        """How many numbers the changes remember."""
        return sum(change.memory for change in self.changes)

    def changed(self, change: ContactChange) -> "SphereContact":
        """The contact with one change more."""
        return replace(self, changes=(*self.changes, change))

    def touch(self, moving: Motion) -> Touch:
        """How the sphere's deepest point meets the plane, over samples (N,)."""
        motion = (moving.R_WJ, moving.p_WJ, moving.velocities)
        depth, rate, slip, position, w_WJ = met(*motion, self.joint, *self._placed)
        return Touch(depth, rate, slip, position, w_WJ, self._below, self._axes)

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        """What the changes remember, (N, m), at samples at `time` (N,) s; see `ContactChange.recall`."""
        return np.concatenate([change.recall(time, touch, at) for change in self.changes], axis=1)

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        """The memory (B, m) `elapsed` (B,) s later, of which `left` (B,) s after a `touch` on the way."""
        parts = [change.ahead(own, touch, elapsed, left) for change, own in self._shared(memory)]
        return np.concatenate(parts, axis=1)

    def force(self, touch: Touch, memory: Array | None = None) -> tuple[Array, Array]:
        """The force (N, 3) N on the sphere at the deepest point, and a moment (N, 3) N m beside it; world axes.

        Without `memory` (N, m) nothing is remembered.
        """
        if memory is None:
            memory = np.zeros((len(touch.rate), self.memory))
        shared = self._shared(memory)
        added = sum(change.push(touch, self.parameters, own) for change, own in shared)
        normal = self.law.normal_force(touch.penetration, touch.rate, self.parameters, added)
        tangential, moment = None, np.zeros_like(touch.slip)
        for change, own in shared:
            found = change.traction(self.law, normal, touch, self.parameters, own)
            tangential = found if found is not None else tangential
            beside = change.moment(normal, touch)
            moment = moment if beside is None else moment + beside
        if tangential is None:
            tangential = self.law.tangential_force(normal, touch.slip, self.parameters)
        pulled = normal + sum(change.pull(touch) for change in self.changes)
        return pulled[:, None] * self.normal + tangential, moment

    def wrench(self, moving: Motion, memory: Array | None = None) -> Array:
        """The wrench (N, 6) on the joint's link about the world origin, moment first."""
        touch = self.touch(moving)
        force, moment = self.force(touch, memory)
        return np.concatenate([cross(touch.position, force) + moment, force], axis=1)

    def _shared(self, memory: Array) -> list[tuple[ContactChange, Array]]:
        """Each change with its own part of the memory."""
        ends = itertools.accumulate(change.memory for change in self.changes)
        return [(change, memory[:, end - change.memory : end]) for change, end in zip(self.changes, ends, strict=True)]


@dataclass(frozen=True)
class WrenchSensor:
    """A sensor that reads what the environment's contact exerts on its body, about and in its frame S."""

    name: str
    joint: int
    R_JS: Array
    p_JS: Array

    def reading(self, moving: Motion, wrench_W: Array) -> Array:
        """(N, 6) force then torque in S about So, from a wrench (N, 6) about the world origin, moment first."""
        R_JS, p_JS, wrench = (np.ascontiguousarray(a, dtype=float) for a in (self.R_JS, self.p_JS, wrench_W))
        found = read(moving.R_WJ, moving.p_WJ, self.joint, R_JS, p_JS, wrench)
        return np.asarray(found, dtype=float)
