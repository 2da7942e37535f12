"""The terms of one recording's rows that follow from its motion and efforts, cached by the sensor effects on these."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.rows.effort_rows import EffortRows
from drake_cafim.diagnosis.rows.force_rows import ForceRows
from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows, lags_of
from drake_cafim.diagnosis.rows.measured_rows import MeasuredRows
from drake_cafim.diagnosis.rows.measurement import Measurement, corrected_measurement, joint_samples_of
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.rows.servo_efforts import ServoDrive, ServoMotion, servo_key
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.inverses import inverses
from drake_cafim.dynamics.motion import Motion, mass_matrix, motion
from drake_cafim.effects.effect import JointSamples
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class MotionTerms:
    """The corrected measurement, the motion that follows from it, and the rows' terms of both."""

    measured: Measurement
    rows: MeasuredRows
    joints: tuple[JointSamples, ...]
    """The samples at which the force laws of joint effects are evaluated, for each joint."""
    moving: Motion
    """The smoothed motion."""
    regressor: InertialRegressor
    kinematic: Array
    """(M, n or 0) ∫ ẇ q dt + ∫ w v dt, corrected for the steps of v̇."""
    driven: EffortRows
    acting: ForceRows
    louder: Array
    """(M, n), the factor that scales `kinematic` to the noise that it has without a sensor's lag."""
    servos: dict[int, ServoDrive] = field(default_factory=dict)
    """The efforts of the servos that drive joints, by the joint's index."""
    in_doubt: dict[tuple[str, float], Array] = field(default_factory=dict, repr=False, compare=False)
    """Cached rows of the unknown initial state of sensors' lags, by the sensor and its time constant."""

    def driven_by(self, servos: dict[int, ServoDrive], load: Array) -> "MotionTerms":
        """The terms with the efforts of `servos` added to the recorded ones, and the `load` (N, n) from outside."""
        if self.kinematic.size:
            servos = {j: self._bent(j, drive, servos) for j, drive in servos.items()}
        u, ramped = self.rows.u.copy(), list(self.rows.ramped)
        for j, drive in servos.items():
            u[:, j] += drive.mean.value
            ramped[j] = True
        joints = tuple(
            joint.under(u[:, j] if j in servos else joint.u, load[:, j]) for j, joint in enumerate(self.joints)
        )
        rows = replace(self.rows, u=u, ramped=tuple(ramped), servos=servos)
        acting = ForceRows(self.acting.windows, self.acting.recording, joints, self.moving)
        driven = EffortRows(rows, self.driven.inverse_mass)
        kinematic = self.kinematic
        if kinematic.size:
            kinematic = kinematic - self.louder * sum(self._correction_of(j, drive) for j, drive in servos.items())
        return replace(self, rows=rows, joints=joints, driven=driven, acting=acting, servos=servos, kinematic=kinematic)

    def _bent(self, joint: int, drive: ServoDrive, servos: Mapping[int, ServoDrive]) -> ServoDrive:
        """The drive of `joint` with the bends split off that the steps of all `servos` cause."""
        for other, steps in servos.items():
            drive = drive.bent_by(self.rows.windows.time, self.driven.inverse_mass[:, joint, other], steps)
        return drive

    def _correction_of(self, joint: int, drive: ServoDrive) -> Array:
        """(M, n) correction of the kinematic rows for the steps of v̇ that a servo's steps cause, M⁻¹ times each."""
        windows, times = self.rows.windows, drive.steps.times
        at = np.clip(np.searchsorted(windows.time, times, side="right") - 1, 0, None)
        acceleration = np.cumsum(self.driven.inverse_mass[at, :, joint] * drive.jumps[:, None], axis=0)
        return np.asarray(windows.steps(times) @ acceleration)


@dataclass(frozen=True)
class MotionTermsCache:
    """The `MotionTerms` of one recording's samples, for the last few sensor effects of motion and effort."""

    samples: Samples
    sensors: tuple[WrenchSensor, ...]
    _cache: dict[tuple[object, ...], MotionTerms] = field(default_factory=dict, repr=False, compare=False)
    _driven: dict[tuple[object, ...], MotionTerms] = field(default_factory=dict, repr=False, compare=False)

    def of(self, physics: Physics) -> MotionTerms:
        """The terms under the sensor effects and the servos of `physics`; its other effects do not matter."""
        key = tuple(
            (effect.key, *effect.values.values()) for effect in physics.sensors if not effect.at.startswith("wrench.")
        )
        if key not in self._cache:
            make_room(self._cache, 4)
            self._cache[key] = self._compute(physics)
        if not self.samples.commands and not physics.depends_on_load:
            return self._cache[key]
        under = (*key, *servo_key(physics))
        if under not in self._driven:
            make_room(self._driven, 8)
            base = self._cache[key]
            motion = ServoMotion(self.samples.time, self._read(physics), base.measured.v, self.samples.commands)
            self._driven[under] = base.driven_by(motion.drives(physics), physics.loads(base.measured.q_hat))
        return self._driven[under]

    def _read(self, physics: Physics) -> Array:
        """(N, n) the positions that the encoders read, corrected for delays and lags of the recording alone."""
        late = tuple(effect for effect in physics.sensors if effect.late)
        if not any(effect.at.startswith("q.") for effect in late):
            return self.samples.q
        return corrected_measurement(self.samples, self.sensors, replace(physics, sensors=late)).q

    @cached_property
    def _kinematic(self) -> KinematicRows:
        return KinematicRows(self.samples)

    @cached_property
    def _links(self) -> LinkRegressors:
        return LinkRegressors(self.samples.windows)

    def _compute(self, physics: Physics) -> MotionTerms:
        samples, windows = self.samples, self.samples.windows
        measured = corrected_measurement(samples, self.sensors, physics)
        moving = replace(motion(physics.tree, measured.q_hat, measured.v_hat), lasting=np.gradient(samples.time))
        joints = samples.q.shape[1]
        kinematic, louder = np.zeros((len(windows), 0)), np.ones((len(windows), joints))
        inverse_mass: Array = np.zeros((0, joints, joints))
        if samples.velocity_measured:
            inverse_mass = inverses(mass_matrix(moving) + np.diag(physics.rotor_inertias))
            correction = _correction_of_efforts(samples, inverse_mass, measured.u)
            lags = lags_of(physics.sensors)
            others = tuple(effect for effect in physics.sensors if effect not in lags)
            as_written = measured
            if lags:
                as_written = corrected_measurement(samples, self.sensors, replace(physics, sensors=others))
            q, v, louder = self._kinematic.compared(lags, physics.tree.joint_names, as_written.q, as_written.v)
            kinematic = (windows.rate @ q + windows.value @ v - correction) * louder
        at_joints = joint_samples_of(samples, measured, samples.v_std)
        regressor = self._links.regressor(moving, measured.v)
        rows = MeasuredRows(windows, measured.v, measured.u, measured.v_hat, measured.wrenches, samples.ramped)
        driven = EffortRows(rows, inverse_mass)
        acting = ForceRows(windows, samples.recording.name, at_joints, moving)
        return MotionTerms(measured, rows, at_joints, moving, regressor, kinematic, driven, acting, louder)


def _correction_of_efforts(samples: Samples, inverse_mass: Array, u: Array) -> Array:
    """(M, n) correction of the kinematic rows for the steps of v̇ that efforts `u` (N, n) cause, M⁻¹ u."""
    time, ramped = samples.time, np.array(samples.ramped)
    total = np.zeros((len(samples.windows), samples.q.shape[1]))
    for ramp in set(samples.ramped):
        acceleration = (inverse_mass @ np.where(ramped == ramp, u, 0.0)[..., None])[..., 0]
        total += samples.windows.steps(time, ramp) @ acceleration
    return total
