"""The terms of one recording's rows that follow from its motion and efforts, cached by the sensor effects on these."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.effort_rows import EffortRows
from drake_cafim.diagnosis.rows.force_rows import ForceRows
from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows, lags_of
from drake_cafim.diagnosis.rows.measured_rows import MeasuredRows
from drake_cafim.diagnosis.rows.measurement import Measurement, corrected_measurement, joint_samples_of
from drake_cafim.diagnosis.rows.samples import Samples
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
    links: LinkRegressors
    kinematic: Array
    """(M, n or 0) ∫ ẇ q dt + ∫ w v dt, corrected for the steps of v̇."""
    driven: EffortRows
    acting: ForceRows
    louder: Array
    """(M, n), the factor that scales `kinematic` to the noise that it has without a sensor's lag."""
    samples: Samples
    in_doubt: dict[tuple[str, float], Array] = field(default_factory=dict, repr=False, compare=False)
    """Cached rows of the unknown initial state of sensors' lags, by the sensor and its time constant."""

    @cached_property
    def regressor(self) -> InertialRegressor:
        """The regressor of inertial and gravity terms."""
        return self.links.regressor(self.moving, self.measured.v, self.moving_at_points, self.samples.law_value)

    @cached_property
    def moving_at_points(self) -> Motion:
        """The motion at the points over which laws are integrated."""
        estimated = self.samples.estimated
        if estimated is None:
            return self.moving
        q, v = (np.stack([getattr(joint, name) for joint in self.acting.joints], axis=1) for name in ("q", "v"))
        return replace(motion(self.moving.tree, q, v), lasting=estimated.points.lasting(self.samples.time))


@dataclass(frozen=True)
class MotionTermsCache:
    """The `MotionTerms` of one recording's samples, for the last few sensor effects of motion and effort."""

    samples: Samples
    sensors: tuple[WrenchSensor, ...]
    _cache: dict[tuple[object, ...], MotionTerms] = field(default_factory=dict, repr=False, compare=False)

    def of(self, physics: Physics) -> MotionTerms:
        """The terms under the sensor effects of `physics`; its other effects do not matter."""
        key = tuple(
            (effect.key, *effect.values.values()) for effect in physics.sensors if not effect.at.startswith("wrench.")
        )
        if key not in self._cache:
            make_room(self._cache, 4)
            self._cache[key] = self._compute(physics)
        return self._cache[key]

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
            kinematic = (windows.rate @ q + windows.velocity @ v - correction) * louder
        at_joints = joint_samples_of(samples, measured, samples.v_std)
        rows = MeasuredRows(windows, measured.v, measured.u, measured.v_hat, measured.wrenches, samples.ramped)
        driven = EffortRows(rows, inverse_mass)
        at_points, value = _law_samples(samples, measured, at_joints)
        acting = ForceRows(windows, samples.recording.name, at_points, value, moving)
        return MotionTerms(measured, rows, at_joints, moving, self._links, kinematic, driven, acting, louder, samples)


def _law_samples(
    samples: Samples, measured: Measurement, at_samples: tuple[JointSamples, ...]
) -> tuple[tuple[JointSamples, ...], sp.csr_matrix]:
    """Each joint's motion where its laws are integrated, and the matrix (M, P) of ∫ w f dt from values there."""
    if samples.estimated is None:
        return at_samples, samples.windows.value
    points, std = samples.estimated.points, samples.estimated.v_std
    at_points = [
        points.samples(samples.time, measured.q[:, j], measured.v[:, j], measured.u[:, j], std[:, j], ramp)
        for j, ramp in enumerate(samples.ramped)
    ]
    return tuple(at_points), points.value


def _correction_of_efforts(samples: Samples, inverse_mass: Array, u: Array) -> Array:
    """(M, n) correction of the kinematic rows for how v̇ changes between samples: by efforts `u` (N, n), M⁻¹ u."""
    time, ramped = samples.time, np.array(samples.ramped)
    total = np.zeros((len(samples.windows), samples.q.shape[1]))
    if samples.estimated is not None:
        # ∫ (t − t̄) a dt of an acceleration that is linear over an interval
        total += samples.windows.interval @ (np.diff(time)[:, None] ** 2 / 12.0 * samples.estimated.bend)
    for ramp in set(samples.ramped):
        acceleration = (inverse_mass @ np.where(ramped == ramp, u, 0.0)[..., None])[..., 0]
        total += samples.windows.steps(time, ramp) @ acceleration
    return total
