"""A sphere of the tree against a plane that stands still: where they touch, and the wrench that follows."""

from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.contact.geometry import ContactPoints, sphere_on_plane
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.dynamics.motion import Motion
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SphereContact:
    """The nominal contact of a sphere that rides a joint with a plane fixed in the world.

    `p_JC` (3,) m is the sphere's centre in frame J of `joint`; the plane passes through `point` with unit `normal`
    out of it, world frame.
    """

    bodies: tuple[str, str]
    joint: int
    p_JC: Array
    radius: float
    point: Array
    normal: Array
    law: ContactLaw
    parameters: ContactParameters

    @property
    def name(self) -> str:
        return "/".join(self.bodies)

    def with_parameter(self, name: str, value: float) -> "SphereContact":
        """The contact with one of its numbers replaced."""
        if name == "radius":
            return replace(self, radius=value)
        return replace(self, parameters=replace(self.parameters, **{name: value}))

    def points(self, moving: Motion) -> ContactPoints:
        """Penetration, its rate and the slip at the sphere's deepest point, over samples (N, 1)."""
        p_WC, v_WC = moving.point(self.joint, self.p_JC)
        w_WJ = moving.velocities[:, self.joint, :3]
        return sphere_on_plane(p_WC, v_WC, w_WJ, radius=self.radius, point=self.point, normal=self.normal)

    def force(self, points: ContactPoints) -> Array:
        """The force (N, 3) on the sphere, N, world axes."""
        normal = self.law.normal_force(points.penetration, points.rate, self.parameters)
        tangential = self.law.tangential_force(normal, points.tangential_velocity, self.parameters)
        return normal * self.normal + tangential[:, 0]

    def wrench(self, moving: Motion) -> Array:
        """The wrench (N, 6) on the joint's link about the world origin, moment first."""
        points = self.points(moving)
        force = self.force(points)
        p_WC, _ = moving.point(self.joint, self.p_JC)
        return np.concatenate([np.cross(p_WC + points.p_BoC_W[:, 0], force), force], axis=1)


@dataclass(frozen=True)
class WrenchSensor:
    """A sensor that reads what the environment's contact exerts on its body, about and in its frame S."""

    name: str
    joint: int
    R_JS: Array
    p_JS: Array

    def reading(self, moving: Motion, wrench_W: Array) -> Array:
        """(N, 6) force then torque in S about So, from a wrench (N, 6) about the world origin, moment first."""
        p_WS, _ = moving.point(self.joint, self.p_JS)
        R_WS = moving.R_WJ[:, self.joint] @ self.R_JS
        force = wrench_W[:, 3:]
        moment = wrench_W[:, :3] - np.cross(p_WS, force)
        return np.concatenate([np.einsum("nji,nj->ni", R_WS, force), np.einsum("nji,nj->ni", R_WS, moment)], axis=1)
