"""Changes of a contact's nominal law: the interface of contact effects, some of which have a memory."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import lapack

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Touch:
    """Kinematics of one contact point over samples: `penetration` (N,) m and its `rate` (N,) m/s.

    In world axes: `slip` (N, 3) m/s, tangential velocity; `position` (N, 3) m of the point; `w` (N, 3) rad/s, angular
    velocity of the body; `arm` (N, 3) m, or (1, 3) if constant, from the sphere's centre to the point; `axes` (3, 3),
    the surface's x, y and normal as columns.
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
        """(N, 3) rad/s, the tangential part of the body's angular velocity."""
        n = self.axes[:, 2]
        return np.asarray(self.w - (self.w @ n)[:, None] * n)

    @cached_property
    def spinning(self) -> Array:
        """(N, 3) m/s, the part w × arm of the slip that comes from the body's rotation."""
        return cross(self.w, self.arm)


class ContactChange:
    """A change of a contact's law; the default methods change nothing. `memory` (N, m) is its internal state."""

    memory: ClassVar[int] = 0
    """Number m of its internal states."""

    @property
    def reach(self) -> float:
        """The distance m between the bodies within which it exerts a force."""
        return 0.0

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        """The memory (N, m) at samples at `time` (N,) s, from all the samples before each.

        `touch` should be smoothed, since a memory integrates it; the force is evaluated `at` the unsmoothed samples.
        """
        return np.zeros((len(time), self.memory))

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        """The memory (B, m) advanced by `elapsed` (B,) s; `touch` is the kinematics `left` (B,) s before the end."""
        return memory

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array | float:
        """A force (N,) N added to the normal force before that is clipped at zero; only where the bodies touch."""
        return 0.0

    def pull(self, touch: Touch) -> Array | float:
        """A normal force (N,) N that does not enter the friction; negative towards the surface."""
        return 0.0

    def traction(
        self, law: ContactLaw, normal: Array, touch: Touch, parameters: ContactParameters, memory: Array
    ) -> Array | None:
        """The tangential force (N, 3) N that replaces the law's, for normal force `normal` (N,) N; None keeps it."""
        return None

    def moment(self, normal: Array, touch: Touch) -> Array | None:
        """An additional moment (N, 3) N m on the body, for normal force `normal` (N,) N; None for no moment."""
        return None


def surface_axes(normal: Array) -> Array:
    """Axes of a plane as columns (3, 3): the world's x (y if `normal` is near x) projected into it, n × x, and n."""
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
