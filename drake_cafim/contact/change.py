"""What a contact does beyond its nominal law: changes of its forces, some of which remember what went before."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import lapack

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Touch:
    """One contact point over samples: `penetration` (N,) m, `rate` (N,) m/s, and in world axes `slip` (N, 3) m/s,
    `position` (N, 3) m of the point, `w` (N, 3) rad/s, the body's angular velocity, and `arm` (N, 3) m, or the same
    for all (1, 3), from what turns with it to the point.

    `axes` (3, 3) are the surface's x, y and normal as columns, world frame.
    """

    penetration: Array
    rate: Array
    slip: Array
    position: Array
    w: Array
    arm: Array
    axes: Array

    def at_depth(self, penetration: float) -> "Touch":
        """The same points at another `penetration` (m), all of them."""
        return replace(self, penetration=np.full_like(self.penetration, penetration))

    @cached_property
    def spin(self) -> Array:
        """(N, 3) rad/s, the body's angular velocity without its turn about the normal."""
        n = self.axes[:, 2]
        return np.asarray(self.w - (self.w @ n)[:, None] * n)

    @cached_property
    def spinning(self) -> Array:
        """(N, 3) m/s, the part of the slip that comes from turning."""
        return cross(self.w, self.arm)


class ContactChange:
    """A change of a contact's law; by default nothing changes. `memory` (N, m) is what it knows of the past."""

    memory: ClassVar[int] = 0
    """How many numbers it remembers."""

    @property
    def reach(self) -> float:
        """From how far outside, m, it is felt."""
        return 0.0

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        """The memory (N, m) at samples at `time` (N,) s, of all the samples before each.

        `touch` is as free of noise as can be, for a memory sums it up; the force is asked for `at` each sample's own.
        """
        return np.zeros((len(time), self.memory))

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        """The memory (B, m) `elapsed` (B,) s later, of which `left` (B,) s after a `touch` on the way."""
        return memory

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array | float:
        """Added (N,) N to the normal force before it is kept from pulling; only where the bodies touch."""
        return 0.0

    def pull(self, touch: Touch) -> Array | float:
        """A normal force (N,) N, towards the surface where negative, that friction knows nothing of."""
        return 0.0

    def traction(
        self, law: ContactLaw, normal: Array, touch: Touch, parameters: ContactParameters, memory: Array
    ) -> Array | None:
        """The tangential force (N, 3) N in place of the law's, given the pushing force (N,) N; None leaves it."""
        return None

    def moment(self, normal: Array, touch: Touch) -> Array | None:
        """A moment (N, 3) N m on the body, given the pushing force (N,) N."""
        return None


def surface_axes(normal: Array) -> Array:
    """(3, 3): the world's x (or y, where the normal is near x) laid into the plane, its left, and the normal."""
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = along - (along @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def recursion(kept: Array, added: Array) -> Array:
    """x (N, k) with x₀ = added₀ and xᵢ = keptᵢ xᵢ₋₁ + addedᵢ, for `kept` (N,) and `added` (N, k)."""
    band = np.ones((2, len(kept)))
    band[1, :-1] = -kept[1:]
    solved, _ = lapack.dtbtrs(band, added, uplo="L")
    return np.asarray(solved, dtype=float)
