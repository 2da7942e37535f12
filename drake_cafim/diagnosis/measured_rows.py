"""What the rows hold of the measurement alone, whatever is tried of the physics: reckoned once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.windows import Windows
from drake_cafim.typing import Array


@dataclass(frozen=True)
class MeasuredRows:
    """Integrals of `v`, `u` and smoothed `v_hat` (N, n), and of the `wrenches` (N, 6) each, over the windows."""

    windows: Windows
    v: Array
    u: Array
    v_hat: Array
    wrenches: tuple[Array, ...]

    @cached_property
    def rate_of_velocity(self) -> Array:
        """∫ ẇ v dt, (M, n)."""
        return np.asarray(self.windows.rate @ self.v)

    @cached_property
    def smoothed_velocity(self) -> Array:
        """∫ w v dt of the smoothed velocity, (M, n)."""
        return np.asarray(self.windows.value @ self.v_hat)

    @cached_property
    def asked(self) -> Array:
        """∫ w u dt, (M, n), of efforts that act as they were asked for."""
        return np.asarray(self.windows.held(self.windows.time) @ self.u)

    @cached_property
    def read(self) -> tuple[Array, ...]:
        """∫ w wrench dt, (M, 6) each."""
        return tuple(np.asarray(self.windows.value @ reading) for reading in self.wrenches)
