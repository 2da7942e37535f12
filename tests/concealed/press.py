"""A Cartesian stage that presses and rubs a sphere on a wall: three sliding axes, a wrench sensor at the tool."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .contact_law import ContactLaw
from .robots import Array, Joint, Link, Robot
from .small import cross
from .urdf import arm_urdf, sphere

NAMES = ("px", "py", "pz")


@dataclass(frozen=True)
class Stage:
    """Masses (kg) of the carriages and the tool; the tip's sphere in the tool frame (m)."""

    robot: Robot
    tip: Array  # (3,)
    radius: float

    @cached_property
    def moved(self) -> Array:
        """Mass (kg) that each axis moves."""
        masses = np.array([link.mass for link in self.robot.links])
        rotors = np.array([joint.rotor_inertia for joint in self.robot.joints])
        return np.asarray(np.cumsum(masses[::-1])[::-1] + rotors)

    @cached_property
    def weight(self) -> Array:
        """Weight (N) of all that hangs on each axis, along it."""
        return np.asarray(np.cumsum([link.mass for link in self.robot.links][::-1])[::-1] * self.robot.gravity)

    def urdf(self) -> str:
        origin = " ".join(repr(float(value)) for value in self.tip)
        shape = f"<geometry>{sphere(self.radius)}</geometry>"
        tip = f'    <collision name="tip"><origin xyz="{origin}"/>{shape}</collision>\n'
        wall = (
            '  <link name="wall">\n    <inertial><mass value="10"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>\n'
            '    <collision name="wall"><origin xyz="0 0 -0.05"/>'
            '<geometry><box size="2 2 0.1"/></geometry></collision>\n  </link>\n'
            '  <joint name="wall_mount" type="fixed"><parent link="base"/><child link="wall"/></joint>\n'
        )
        return arm_urdf(self.robot, {"tool": tip}, wall)


def random_stage(rng: np.random.Generator) -> Stage:
    masses = np.round([rng.uniform(1.5, 3.5), rng.uniform(1.0, 2.5), rng.uniform(0.7, 1.8)], 3)
    links = tuple(
        Link(name, float(mass), com, np.eye(3) * 0.006 * mass)
        for name, mass, com in zip(
            ("carriage_x", "carriage_y", "tool"),
            masses,
            (np.zeros(3), np.zeros(3), np.array([0.0, 0.0, -0.03])),
            strict=True,
        )
    )
    joints = tuple(
        Joint(name, "prismatic", index - 1, np.zeros(3), np.zeros(3), np.eye(3)[index])
        for index, name in enumerate(NAMES)
    )
    robot = Robot("press", links, joints, np.array([0.0, 0.0, -9.81]))
    return Stage(
        robot,
        np.array([0.0, 0.0, -float(np.round(rng.uniform(0.08, 0.15), 3))]),
        float(np.round(rng.uniform(0.006, 0.015), 4)),
    )


@dataclass(frozen=True)
class PressPlant:
    """The stage's accelerations for a batch of `copies`; hidden: those of one contact point."""

    stage: Stage
    law: ContactLaw
    copies: int
    hidden = ContactLaw.hidden

    def initial_hidden(self, q: Array) -> Array:
        return np.zeros((len(q), self.hidden))

    def contact_point(self, q: Array) -> Array:
        """The sphere's deepest point (B, 3) towards the true surface."""
        return q + self.stage.tip - self._reach

    @cached_property
    def _reach(self) -> Array:
        return np.asarray(self.stage.radius * self.law.normal)

    def boundary(self, t: Array, q: Array, v: Array, z: Array) -> Array:
        return self.law.depth(t, self.contact_point(q)[:, None, :])

    def contact(self, t: Array, q: Array, v: Array, z: Array, mode: np.ndarray) -> tuple[Array, Array]:
        """Force (B, 3) on the tool and the hidden states' rates."""
        force, _, rates, _ = self.law.force(t, self.contact_point(q)[:, None, :], v[:, None, :], z[:, None, :], mode)
        return force[:, 0], rates[:, 0]

    def acceleration(self, t: Array, q: Array, v: Array, z: Array, mode: np.ndarray, tau: Array) -> tuple[Array, Array]:
        force, rates = self.contact(t, q, v, z, mode)
        return (tau + force + self.stage.weight) / self.stage.moved, rates

    def wrench(self, t: Array, q: Array, v: Array, z: Array, mode: np.ndarray) -> Array:
        """What the wall exerts about the tool frame's origin, in tool axes (those of the world): (B, 6)."""
        force, _ = self.contact(t, q, v, z, mode)
        return np.concatenate([force, cross(self.contact_point(q) - q, force)], axis=1)
