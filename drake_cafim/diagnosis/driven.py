"""What becomes of a recording's efforts under actuator effects, in its rows; the last few are kept."""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.measured_rows import MeasuredRows
from drake_cafim.effects.actuator import ActuatorLag, Effort
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

KEPT = 16
"""Of what efforts become under numbers that are tried."""


@dataclass(frozen=True)
class Driven:
    """What acts at one joint: ∫ w u dt `integral` (M,), and by what v `steps` otherwise than was asked (M, n or 0)."""

    integral: Array
    steps: Array


@dataclass(frozen=True)
class DrivenRows:
    """The efforts behind `rows`; `inverse_mass` (N, n, n) where velocities are measured, else empty."""

    rows: MeasuredRows
    inverse_mass: Array
    _driven: dict[tuple[object, ...], Driven] = field(default_factory=dict, repr=False, compare=False)
    _behind: dict[tuple[object, ...], float] = field(default_factory=dict, repr=False, compare=False)

    def integral(self, physics: Physics) -> Array:
        """∫ w u dt (M, n)."""
        integral = self.rows.asked.copy()
        for j in _changed(physics):
            integral[:, j] = self._of(physics, j).integral
        return integral

    def steps(self, physics: Physics) -> Array:
        """What efforts that act otherwise than was asked for change in how v steps, (M, n or 0)."""
        steps = np.zeros((len(self.rows.windows), self.rows.u.shape[1] if len(self.inverse_mass) else 0))
        for j in _changed(physics) if steps.size else ():
            steps += self._of(physics, j).steps
        return steps

    def std_behind(self, physics: Physics, lag: ActuatorLag) -> float:
        """How far, on the average, an effort that lags is off what was asked for."""
        key = (lag.at, lag.values["time_constant"])
        if key not in self._behind:
            time, asked = self.rows.windows.time, self.rows.u[:, physics.tree.joint_index(lag.at)]
            make_room(self._behind, KEPT)
            self._behind[key] = float(np.std(asked - lag.drive(Effort(time, asked)).means(time)))
        return self._behind[key]

    def _of(self, physics: Physics, joint: int) -> Driven:
        name = physics.tree.joints[joint].name
        key = (joint, *((one.name, *one.values.values()) for one in physics.actuators if one.at == name))
        if key not in self._driven:
            windows = self.rows.windows
            effort = effort_at(physics, joint, Effort(windows.time, self.rows.u[:, joint]))
            integral = np.asarray(windows.held(effort.times) @ effort.values)
            make_room(self._driven, KEPT)
            self._driven[key] = Driven(integral, self._step(joint, effort))
        return self._driven[key]

    def _step(self, joint: int, effort: Effort) -> Array:
        windows, asked = self.rows.windows, self.rows.u[:, joint : joint + 1]
        if not len(self.inverse_mass):
            return np.zeros((len(windows), 0))
        by_effort = self.inverse_mass[:, :, joint]
        at = np.clip(np.searchsorted(windows.time, effort.times, side="right") - 1, 0, None)
        acting = windows.steps(effort.times) @ (by_effort[at] * effort.values[:, None])
        return np.asarray(acting - windows.steps(windows.time) @ (by_effort * asked))


def effort_at(physics: Physics, joint: int, asked: Effort) -> Effort:
    """What acts at a joint."""
    for effect in physics.actuators:
        if effect.at == physics.tree.joints[joint].name:
            asked = effect.drive(asked)
    return asked


def _changed(physics: Physics) -> set[int]:
    return {physics.tree.joint_index(effect.at) for effect in physics.actuators}
