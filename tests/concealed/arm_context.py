"""Motion, efforts and sampling of an arm, by which the strengths of its random effects are scaled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .robots import Array, Robot
from .truth import Concealed


@dataclass(frozen=True)
class ArmContext:
    """What a strength is scaled by: the desired motion and its efforts (B, N, n)."""

    robot: Robot
    q: Array
    v: Array
    u: Array
    duration: float
    has_velocity: bool
    recordings: tuple[str, ...]

    def effort(self, joint: int) -> float:
        """Typical effort of a joint that moves: its rms, or a share of the largest joint's where it hardly works."""
        rms = np.sqrt(np.mean(self.u**2, axis=(0, 1)))
        return float(max(rms[joint], 0.05 * rms.max()))

    def speed(self, joint: int) -> float:
        return float(max(np.sqrt(np.mean(self.v[:, :, joint] ** 2)), 0.02))

    def moving(self) -> list[int]:
        """Joints that move: nothing can be learnt of the friction of a joint at rest."""
        rms = np.sqrt(np.mean(self.v**2, axis=(0, 1)))
        return [int(joint) for joint in np.flatnonzero(rms > 0.1 * rms.max())]

    def unit(self, joint: int, rotary: str) -> str:
        if self.robot.joints[joint].kind == "revolute":
            return rotary
        return {
            "N m": "N",
            "N m s/rad": "N s/m",
            "N m/rad": "N/m",
            "rad": "m",
            "rad/s": "m/s",
            "kg m^2": "kg",
            "1/rad": "1/m",
        }[rotary]


Draw = Callable[[np.random.Generator, ArmContext, int], Concealed]
