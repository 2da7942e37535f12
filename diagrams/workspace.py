"""Limits commanded velocities so that the tool can brake before the bounds of its workspace."""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.typing import Array


@dataclass
class Workspace:
    """Bounds of the tool's position in the planner's coordinates, and the deceleration available before them."""

    lower: list[float] = field(default_factory=list)  # m, one a coordinate
    upper: list[float] = field(default_factory=list)  # m
    braking_at_lower: float = 20.0  # m/s²
    braking_at_upper: float = 20.0  # m/s²

    def allowed(self, command: Array, position: Array, velocity: Array, *, period: float, ramp: float) -> Array:
        """`command` (nu,) m/s reduced so that a tool at `position` m with `velocity` m/s stays within the bounds.

        The velocity takes `ramp` s to get from `velocity` to the command, which lasts `period` s.
        """
        coasted = position + 0.5 * ramp * velocity
        held = period - 0.5 * ramp
        up = _fastest(np.asarray(self.upper) - coasted, self.braking_at_upper, held)
        down = -_fastest(coasted - np.asarray(self.lower), self.braking_at_lower, held)
        return np.asarray(np.maximum(np.minimum(command, up), down))


def _fastest(room: Array, braking: float, held: float) -> Array:
    """Greatest u (nu,) with held·u + u²/(2 braking) ≤ room; where there is no room, the way back into it."""
    root = np.sqrt(held**2 + 2.0 * np.maximum(room, 0.0) / braking)
    return np.asarray(np.where(room >= 0, braking * (root - held), room / held))
