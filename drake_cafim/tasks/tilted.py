"""The base of planning models in a plane whose touched object may be turned from where it is planned."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.parameters import Parameters
from drake_cafim.sensitivity.model import Jacobians
from drake_cafim.tasks.point import PointModel
from drake_cafim.typing import Array

TILT = "tilt"
"""Name of the parameter, rad, anticlockwise in the plane of the planner's coordinates."""


@dataclass(frozen=True, kw_only=True)
class TiltedModel(PointModel):
    """A contact in the plane, turned by an unknown angle α about `pivot` if `tilt` is among the parameters.

    With the upright force f of motion (p, v) it is λ = R f(c + Rᵀ(p − c), Rᵀ v), R the rotation by α and c the pivot;
    the sensor's axes are not turned. Offsets are along the turned axes.
    """

    parameters: Parameters

    @property
    def tilts(self) -> tuple[str, ...]:
        """The parameters that say by what angle the contact's frame is turned from the plan's."""
        return (TILT,)

    @property
    @abstractmethod
    def pivot(self) -> Array:
        """The point (2,) m about which it is turned."""

    @abstractmethod
    def upright_force(self, motion: Array, theta: Array) -> Array:
        """λ (..., 2) N where nothing is turned; scalar-generic."""

    @abstractmethod
    def upright_jacobians(self, motion: Array, theta: Array) -> tuple[Jacobians, Array]:
        """`upright_force` with its derivatives, zero by the tilt, and its derivatives by the motion (..., 2, 4)."""

    def upright_motion(self, motion: Array, theta: Array) -> Array:
        """The motion (..., 4) as seen from the frame of what is touched, were that not turned."""
        if TILT not in self.parameters.names:
            return motion
        angle = self._angle(theta)
        place = self.pivot + turned(motion[..., :2] - self.pivot, -angle)
        return np.concatenate([place, turned(motion[..., 2:4], -angle)], axis=-1)

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        force = self.upright_force(self.upright_motion(motion, theta), theta)
        return force if TILT not in self.parameters.names else turned(force, self._angle(theta))

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        """With q = Rᵀ(p − c) and w = Rᵀ v: ∂λ/∂α = S λ − R (f_q S q + f_w S w), S the rotation by a right angle."""
        upright = self.upright_motion(motion, theta)
        exact, by_motion = self.upright_jacobians(upright, theta)
        if TILT not in self.parameters.names:
            return exact
        angle, right = self._angle(theta), 0.5 * np.pi
        force = turned(exact.value, angle)
        parts = [turned(part, right) for part in (upright[..., :2] - self.pivot, upright[..., 2:4])]
        moved = np.concatenate(parts, axis=-1)
        columns = np.moveaxis(turned(np.moveaxis(exact.wrt_parameters, -1, 0), angle), 0, -1)
        change = turned(np.einsum("...ij,...j->...i", by_motion, moved), angle)
        columns[..., self.parameters.names.index(TILT)] = turned(force, right) - change
        return Jacobians(force, exact.wrt_state, exact.wrt_force, columns)

    def _angle(self, theta: Array) -> Any:
        return np.asarray(theta)[..., self.parameters.names.index(TILT)]


def turned(vectors: Array, angle: Any) -> Array:
    """Vectors (..., 2) rotated anticlockwise by `angle` rad, a number or (...,)."""
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * first - sin * second, sin * first + cos * second], axis=-1)
