"""The rows' terms of the efforts that act under actuator effects, cached for the last few parameter values."""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.rows.measured_rows import MeasuredRows
from drake_cafim.diagnosis.rows.mobility import Mobility, rotors_of
from drake_cafim.diagnosis.rows.servo_efforts import answers_to_steps
from drake_cafim.diagnosis.thresholds import MASS_MATRIX_STD
from drake_cafim.effects.actuator import ActuatorEffect, Effort
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

CACHED_TERMS = 16
"""Most cached terms of each kind."""


@dataclass(frozen=True)
class ActingEffort:
    """The terms of one joint's acting effort u: `integral` ∫ w u dt (M,), and the correction `steps` (M, n or 0).

    `steps` is the correction of the kinematic rows for steps of v̇, less that of the commanded effort.
    """

    integral: Array
    steps: Array


@dataclass(frozen=True)
class EffortRows:
    """The rows' terms of efforts; `mobility` where velocities are measured, else None."""

    rows: MeasuredRows
    mobility: Mobility | None
    _acting: dict[tuple[object, ...], ActingEffort] = field(default_factory=dict, repr=False, compare=False)
    _asked: dict[tuple[float, ...], Array] = field(default_factory=dict, repr=False, compare=False)
    _behind: dict[tuple[object, ...], float] = field(default_factory=dict, repr=False, compare=False)

    def integral(self, physics: Physics) -> Array:
        """∫ w u dt (M, n) of the efforts that act under `physics`, M windows."""
        integral = self.rows.asked.copy()
        for j in _changed(physics):
            integral[:, j] = self._of(physics, j).integral
        return integral

    def steps(self, physics: Physics) -> Array:
        """(M, n or 0) correction of the kinematic rows for the steps of v̇ that the acting efforts u cause, M⁻¹ u."""
        if self.mobility is None:
            return np.zeros((len(self.rows.windows), 0))
        rotors = rotors_of(physics)
        if rotors not in self._asked:
            make_room(self._asked, CACHED_TERMS)
            self._asked[rotors] = self._steps_of_asked(self.mobility.of(physics))
        steps = self._asked[rotors].copy()
        for j in _changed(physics):
            steps += self._of(physics, j).steps
        return steps

    def _steps_of_asked(self, mobility: Array) -> Array:
        """(M, n) the correction for the efforts as commanded, those of servos by their own steps."""
        windows, ramped = self.rows.windows, np.array(self.rows.ramped)
        u = self.rows.u.copy()
        for j, drive in self.rows.servos.items():
            u[:, j] -= drive.mean.value
        total = np.zeros((len(windows), u.shape[1]))
        for ramp in set(self.rows.ramped):
            acceleration = (mobility @ np.where(ramped == ramp, u, 0.0)[..., None])[..., 0]
            total += windows.correct_steps(windows.time, acceleration, ramp)
        for j, drive in self.rows.servos.items():
            if drive.response is not None:
                total += windows.interval @ (mobility[:-1, :, j] * drive.response.moment[:, None])
        return total

    def doubted_steps(self, physics: Physics) -> Array:
        """(M, n or 0) change of `steps` by a relative error `MASS_MATRIX_STD` of the mobility.

        Where a servo takes a step back before the next sample, its correction depends on the mobility only little.
        """
        steps = self.steps(physics)
        if self.mobility is None:
            return steps
        windows, mobility = self.rows.windows, self.mobility.of(physics)
        lighter = answers_to_steps(self.rows.servos, windows.time, (1.0 + MASS_MATRIX_STD) * mobility)
        by_servos, doubted = np.zeros_like(steps), np.zeros_like(steps)
        for j, drive in self.rows.servos.items():
            if drive.response is not None:
                of_steps = mobility[:-1, :, j] * drive.response.moment[:, None]
                by_servos += windows.interval @ of_steps
                moved = (1.0 + MASS_MATRIX_STD) * mobility[:-1, :, j] * lighter[j].moment[:, None]
                doubted += windows.interval @ (moved - of_steps)
        return MASS_MATRIX_STD * (steps - by_servos) + doubted

    def effort(self, physics: Physics, joint: int) -> Effort:
        """The effort that acts at `joint` over time, its actuator effects included."""
        return effort_at(physics, joint, self.rows.effort(joint))

    def mean_effort(self, physics: Physics) -> Array:
        """(N, n) mean effort that acts at each joint from one sample to the next, rotor inertia not subtracted."""
        acting = self.rows.u.copy()
        for j in _changed(physics) | set(np.flatnonzero(self.rows.ramped).tolist()):
            acting[:, j] = self.effort(physics, j).means(self.rows.windows.time)
        return acting

    def at_samples(self, physics: Physics) -> Array:
        """(N, n) effort that acts at each joint at the samples, those of ramped joints between their knots."""
        acting, time = self.rows.u.copy(), self.rows.windows.time
        for j in set(np.flatnonzero(self.rows.ramped).tolist()):
            effort = self.effort(physics, j)
            acting[:, j] = np.interp(time, effort.times, effort.values)
        return acting

    def std_behind(self, physics: Physics, lag: ActuatorEffect) -> float:
        """Standard deviation over time of the commanded effort less the effort that acts under `lag`, N m or N."""
        key = (lag.at, lag.settling or 0.0)
        if key not in self._behind:
            time, asked = self.rows.windows.time, self.rows.effort(physics.tree.joint_index(lag.at))
            make_room(self._behind, CACHED_TERMS)
            self._behind[key] = float(np.std(_means(asked, time) - lag.drive(asked).means(time)))
        return self._behind[key]

    def _of(self, physics: Physics, joint: int) -> ActingEffort:
        """The terms of one joint, cached by its actuator effects."""
        name = physics.tree.joints[joint].name
        acting = ((effect.name, *effect.values.values()) for effect in physics.actuators if effect.at == name)
        key = (joint, rotors_of(physics), *acting)
        if key not in self._acting:
            windows = self.rows.windows
            effort = self.effort(physics, joint)
            integral = windows.integrate_held(effort.times, effort.values, effort.ramped)
            if joint in self.rows.servos:
                # the means around the samples stand for the steps between them in the difference alone
                integral = (
                    self.rows.asked[:, joint]
                    + integral
                    - windows.integrate_held(windows.time, self.rows.u[:, joint], True)
                )
            make_room(self._acting, CACHED_TERMS)
            self._acting[key] = ActingEffort(integral, self._step(physics, joint, effort))
        return self._acting[key]

    def _step(self, physics: Physics, joint: int, effort: Effort) -> Array:
        windows, asked = self.rows.windows, self.rows.u[:, joint : joint + 1]
        if self.mobility is None:
            return np.zeros((len(windows), 0))
        by_effort = self.mobility.of(physics)[:, :, joint]
        at = np.clip(np.searchsorted(windows.time, effort.times, side="right") - 1, 0, None)
        acting = windows.correct_steps(effort.times, by_effort[at] * effort.values[:, None], effort.ramped)
        return acting - windows.correct_steps(windows.time, by_effort * asked, self.rows.ramped[joint])


def effort_at(physics: Physics, joint: int, asked: Effort) -> Effort:
    """The effort that acts at `joint` when the effort `asked` is commanded: all its actuator effects in order."""
    for effect in physics.actuators:
        if effect.at == physics.tree.joints[joint].name:
            asked = effect.drive(asked)
    return asked


def _means(effort: Effort, time: Array) -> Array:
    """(N,) mean effort from each of `time` (N,) s to the next; for a held effort that is its value."""
    return effort.means(time) if effort.ramped else effort.values


def _changed(physics: Physics) -> set[int]:
    """Indices of the joints that have an actuator effect."""
    return {physics.tree.joint_index(effect.at) for effect in physics.actuators}
