"""Contact of a sphere on the tree with a box that is fixed in the world, all round: at its sides, edges and corners."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.dynamics.box_contact import EXTENTS
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SphereOnBox(SphereContact):
    """The law acts between the sphere and the box's nearest point, along the line between that and the centre.

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

    def with_parameter(self, name: str, value: float) -> SphereContact:
        """The contact with one parameter replaced; the box's `length`, `width` and `height` are parameters too."""
        if name not in EXTENTS:
            return super().with_parameter(name, value)
        size = self.size.copy()
        size[EXTENTS.index(name)] = value
        return replace(self, size=size)
