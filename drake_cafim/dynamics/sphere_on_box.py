"""Contact of a sphere on the tree with a box that is fixed in the world, all round: at its sides, edges and corners."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.contact.edge import wedge_volume
from drake_cafim.contact.pressure import surface_deficit
from drake_cafim.dynamics.box_contact import EXTENTS
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SphereOnBox(SphereContact):
    """The law acts between the sphere and the box's nearest point, along the line between that and the centre.

    But the pressure field of a soft box, see `force`.

    `point` (3,) m is the box's centre, `size` (3,) m are its extents along the axes G, the columns of `R_WG`; `normal`
    is the third of them.
    """

    size: Array = field(default_factory=lambda: np.zeros(3))
    R_WG: Array = field(default_factory=lambda: np.eye(3))

    @property
    def flat(self) -> bool:
        return False

    @property
    def place(self) -> tuple[Array, ...]:
        return (self.point, self.R_WG, self.size)

    def raised(self, offset: float) -> SphereContact:
        return replace(self, size=self.size + 2.0 * offset)

    def outward(self, touch: Touch) -> Array:
        return np.asarray(-touch.arm / self.radius)

    def touch(self, moving: Motion) -> Touch:
        """The kinematics of the sphere's point nearest to the box; where its centre is inside, to the nearest side."""
        p_WC, v_WC = moving.point(self.joint, self.p_JC)
        p_GC = (p_WC - self.point) @ self.R_WG
        beyond = np.abs(p_GC) - 0.5 * self.size
        outside = np.maximum(beyond, 0.0)
        far = np.linalg.norm(outside, axis=1)
        side = np.eye(3)[np.argmax(beyond, axis=1)]
        direction = np.where((far > 0.0)[:, None], outside / np.where(far > 0.0, far, 1.0)[:, None], side)
        normal = (direction * np.where(p_GC >= 0.0, 1.0, -1.0)) @ self.R_WG.T
        arm, w_WJ = -self.radius * normal, moving.velocities[:, self.joint, :3]
        velocity = v_WC + cross(w_WJ, arm)
        rate = -np.einsum("ni,ni->n", normal, velocity)
        depth = self.radius - np.where(far > 0.0, far, np.max(beyond, axis=1))
        return Touch(depth, rate, velocity + rate[:, None] * normal, p_WC + arm, w_WJ, arm, self._axes)

    def force(self, touch: Touch, memory: Array | None = None) -> tuple[Array, Array]:
        """As of a plane; but of a soft box under `hydroelastic` the pressure is nearest to two faces at an edge."""
        if not self._is_field:
            return super().force(touch, memory)
        outward, touching = self.outward(touch), touch.penetration > 0.0
        field = np.where(touching[:, None], self._field_force(touch), 0.0)
        split = self._split(np.zeros((len(touch.rate), self.memory)) if memory is None else memory)
        added = sum((change.push(touch, self.parameters, part) for change, part in split), np.zeros(len(touching)))
        pushed = np.einsum("ni,ni->n", field, outward)
        more = np.where(touching, np.maximum(added, -pushed), 0.0) + sum(change.pull(touch) for change in self.changes)
        moments = (change.moment(pushed, touch) for change in self.changes)
        moment = sum((found for found in moments if found is not None), np.zeros_like(field))
        rubbed = self.law.tangential_force(np.linalg.norm(field, axis=1), touch.slip, self.parameters)
        return field + more[:, None] * outward + rubbed, moment

    @property
    def _is_field(self) -> bool:
        return self.law.normal == "hydroelastic" and self.parameters.half_extent != 0.0

    def pushed(self, touch: Touch) -> Array:
        """The sphere's centre where the pressure acts on its surface, and its deepest point else."""
        return np.asarray(touch.position - touch.arm) if self._is_field else super().pushed(touch)

    def _field_force(self, touch: Touch) -> Array:
        """(N, 3) N: for each pair of faces the gradient times the sphere's volume that is nearest to it.

        An edge is one of two faces: of the third pair the sphere is taken to be out of reach (`contact/edge.py`).
        """
        given, velocity = self.parameters, (touch.slip - touch.rate[:, None] * self.outward(touch)) @ self.R_WG
        radius = given.radius - surface_deficit(given.radius, given.resolution)
        p_GC = (touch.position - touch.arm - self.point) @ self.R_WG
        side = np.where(p_GC >= 0.0, 1.0, -1.0)
        beyond = (np.abs(p_GC) - 0.5 * self.size) / radius
        order, rows = np.argsort(-beyond, axis=1), np.arange(len(beyond))
        volume = np.zeros_like(beyond)
        for first, second in ((0, 1), (1, 0)):
            axis, other = order[:, first], order[:, second]
            volume[rows, axis] = wedge_volume(beyond[rows, axis], beyond[rows, other])[0]
        through = np.maximum(1.0 - given.dissipation * side * velocity, 0.0)
        gradient = given.modulus / given.half_extent
        return np.asarray((gradient * radius**3 * volume * through * side) @ self.R_WG.T, dtype=float)

    def with_parameter(self, name: str, value: float) -> SphereContact:
        """The contact with one parameter replaced; the box's `length`, `width` and `height` are parameters too."""
        if name not in EXTENTS:
            return super().with_parameter(name, value)
        size = self.size.copy()
        size[EXTENTS.index(name)] = value
        return replace(self, size=size)
