"""The rows' terms that depend on the measurement alone, not on the physics: computed once."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.rows.servo_efforts import ServoDrive
from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.effects.actuator import Effort
from drake_cafim.typing import Array


@dataclass(frozen=True)
class MeasuredRows:
    """Integrals over M windows of the measured `v`, `u`, (N, n) each, and `wrenches` (N, 6).

    `ramped` (n) is True where a joint's effort is linear from sample to sample (first-order hold), False where it is
    held.
    """

    windows: Windows
    v: Array
    u: Array
    wrenches: tuple[Array, ...]
    ramped: tuple[bool, ...]
    servos: Mapping[int, ServoDrive] = field(default_factory=dict)
    """The servos that drive joints, by the joint's index; `u` holds the means of their efforts, as if ramped."""

    @cached_property
    def rate_of_velocity(self) -> Array:
        """∫ ẇ v dt, (M, n)."""
        return np.asarray(self.windows.rate @ self.v)

    @cached_property
    def asked(self) -> Array:
        """∫ w u dt, (M, n), of the commanded efforts."""
        return np.stack([self._integral(j) for j in range(len(self.ramped))], axis=1)

    def _integral(self, joint: int) -> Array:
        if joint not in self.servos:
            return self.windows.integrate_held(self.windows.time, self.u[:, joint], self.ramped[joint])
        drive = self.servos[joint]
        held = drive.ramps if drive.response is not None else (drive.steps, *drive.ramps)
        found = self.windows.value @ drive.rest
        for effort in held:
            found = found + self.windows.integrate_held(effort.times, effort.values, effort.ramped)
        return np.asarray(found if drive.response is None else found + self.windows.interval @ drive.response.integral)

    def effort(self, joint: int) -> Effort:
        """The commanded effort of `joint` over time."""
        return Effort(self.windows.time, self.u[:, joint], self.ramped[joint])

    @cached_property
    def read(self) -> tuple[Array, ...]:
        """∫ w wrench dt, (M, 6) for each sensor."""
        return tuple(np.asarray(self.windows.value @ reading) for reading in self.wrenches)
