"""Contact of a floating body's box with a plane: each of the box's eight corners is a contact point."""

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.typing import Array

EXTENTS = ("length", "width", "height")


@dataclass(frozen=True)
class BoxContact(SphereContact):
    """Corners of a box of extents `size` (3,) m about `p_JC`, in axes G turned by `R_JG`; stiffness is per corner."""

    size: Array = field(default_factory=lambda: np.zeros(3))
    R_JG: Array = field(default_factory=lambda: np.eye(3))

    @property
    def points(self) -> Array:
        """(8, 3) m, the corners in frame J."""
        corners = 0.5 * self.size * np.array(list(product((-1.0, 1.0), repeat=3)))
        return np.asarray(self.p_JC + corners @ self.R_JG.T, dtype=float)

    def by_point(self) -> tuple[SphereContact, ...]:
        """One contact of a point for each corner."""
        rest = (self.point, self.normal, self.law, self.parameters, self.changes)
        return tuple(SphereContact(self.bodies, self.joint, corner, 0.0, *rest) for corner in self.points)

    def with_parameter(self, name: str, value: float) -> "SphereContact":
        """The contact with one parameter replaced; the box's `length`, `width` and `height` are parameters too."""
        if name in EXTENTS:
            size = self.size.copy()
            size[EXTENTS.index(name)] = value
            return replace(self, size=size)
        return super().with_parameter(name, value)
