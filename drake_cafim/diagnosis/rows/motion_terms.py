"""The terms of one recording's rows that follow from its motion and efforts, cached by the sensor effects on these."""

import operator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.effort_rows import EffortRows
from drake_cafim.diagnosis.rows.force_rows import ForceRows
from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.diagnosis.rows.inertial_rows import InertialRows
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows, lags_of
from drake_cafim.diagnosis.rows.measured_rows import MeasuredRows
from drake_cafim.diagnosis.rows.measurement import Measurement, corrected_measurement, joint_samples_of
from drake_cafim.diagnosis.rows.mobility import Mobility, rotors_of
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.rows.servo_efforts import (
    ServoDrive,
    ServoMotion,
    servo_key,
    split_by_parameter,
    split_steps,
    step_answers,
)
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.step_response import Answers
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
    inertial: InertialRows
    """The inertial and gravity terms."""
    kinematic: Array
    """(M, n or 0) ∫ ẇ q dt + ∫ w v dt, not corrected for the steps of v̇ yet."""
    driven: EffortRows
    acting: ForceRows
    louder: Array
    """(M, n), the factor that scales `kinematic` to the noise that it has without a sensor's lag."""
    samples: Samples
    servos: dict[int, ServoDrive] = field(default_factory=dict)
    """The efforts of the servos that drive joints, by the joint's index."""
    acted_on: ServoMotion | None = None
    """What the servos act on; None where none may drive."""
    _answers: list[Answers] = field(default_factory=list, repr=False, compare=False)
    """Cache: the answers of the joints to the steps of all servos."""
    _loads: list[tuple[Physics, Array]] = field(default_factory=list, repr=False, compare=False)
    """Cache: the last load from outside, and the physics that it follows from."""
    in_doubt: dict[tuple[str, float], Array] = field(default_factory=dict, repr=False, compare=False)
    """Cached rows of the unknown initial state of sensors' lags, by the sensor and its time constant."""

    @property
    def regressor(self) -> InertialRegressor:
        """The regressor of inertial and gravity terms."""
        return self.inertial.regressor

    @cached_property
    def moving_at_points(self) -> Motion:
        """The motion at the points over which laws are integrated."""
        estimated = self.samples.estimated
        if estimated is None:
            return self.moving
        return replace(
            motion(self.moving.tree, *self.inertial.at_points), lasting=estimated.points.lasting(self.samples.time)
        )

    def driven_by(self, acted_on: ServoMotion, load: Array, physics: Physics) -> "MotionTerms":
        """The terms with the efforts of servos added to the recorded ones, and the `load` (N, n) from outside.

        `acted_on` is what the servos act on.
        """
        servos = acted_on.drives(physics)
        if servos:
            servos = split_steps(servos, self.rows.windows.time, self.mobility.of(physics))
        u, ramped = self.rows.u.copy(), list(self.rows.ramped)
        for j, drive in servos.items():
            u[:, j] += drive.mean.value
            ramped[j] = True
        rows = replace(self.rows, u=u, ramped=tuple(ramped), servos=servos)
        driven = EffortRows(rows, self.driven.mobility)
        joints = tuple(
            joint.under(u[:, j] if j in servos else joint.u, load[:, j]) for j, joint in enumerate(self.joints)
        )
        at_points, estimated = joints, self.samples.estimated
        if estimated is not None:
            efforts, loads = estimated.points.between(u), estimated.points.between(load)
            at_points = tuple(
                joint.under(efforts[:, j] if j in servos else joint.u, loads[:, j])
                for j, joint in enumerate(self.acting.joints)
            )
        acting = ForceRows(self.acting.windows, self.acting.recording, at_points, self.acting.value, self.moving)
        return replace(
            self, rows=rows, joints=joints, driven=driven, acting=acting, servos=servos, acted_on=acted_on, _answers=[]
        )

    def load(self, physics: Physics) -> Array:
        """(N, n) the efforts by gravity and contacts at the joints, at rest at the smoothed positions."""
        if self._loads:
            before, load = self._loads[0]
            # a contact holds arrays, which `==` would compare entry by entry
            known, own = ((it.tree, *it.contacts) for it in (before, physics))
            same = len(known) == len(own) and all(map(operator.is_, known, own))
            if same and np.array_equal(before.gravity, physics.gravity):
                return load
        self._loads[:] = [(physics, physics.loads(self.measured.q_hat))]
        return self._loads[0][1]

    def by_servo(self, physics: Physics, joint: int, parameter: str) -> tuple[EffortRows, Array]:
        """The derivatives of `driven`, and of a joint's effort (N,), by its servo's "stiffness" or "damping".

        The servo has no sag, and the joint no actuator effect.
        """
        assert self.acted_on is not None
        time, mobility = self.rows.windows.time, self.mobility.of(physics)
        own = self.acted_on.by_parameter(physics, joint, parameter)
        servo = physics.servo_at(physics.tree.joint_names[joint])
        settling = self.servos[joint].settling_by(parameter, servo, mobility[:, joint, joint])
        if not self._answers:
            self._answers.append(step_answers(self.servos, time, mobility))
        servos = split_by_parameter(self._answers[0], joint, own, settling)
        u = np.zeros_like(self.rows.u)
        u[:, joint] = own.mean.value
        return EffortRows(replace(self.rows, u=u, servos=servos), self.driven.mobility), own.mean.value

    @cached_property
    def mobility(self) -> Mobility:
        return self.driven.mobility or Mobility(self.moving)


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
            self._cache[key] = self._compute(physics, as_measured=not key)
        if not self.samples.commands and not physics.depends_on_load:
            return self._cache[key]
        under = (*key, *servo_key(physics), rotors_of(physics))
        if under not in self._driven:
            make_room(self._driven, 8)
            base = self._cache[key]
            motion = ServoMotion(self.samples.time, self._read(physics), base.measured.v, self.samples.commands)
            self._driven[under] = base.driven_by(motion, base.load(physics), physics)
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

    def _compute(self, physics: Physics, as_measured: bool) -> MotionTerms:
        samples, windows = self.samples, self.samples.windows
        measured = corrected_measurement(samples, self.sensors, physics)
        moving = replace(motion(physics.tree, measured.q_hat, measured.v_hat), lasting=np.gradient(samples.time))
        joints = samples.q.shape[1]
        kinematic, louder = np.zeros((len(windows), 0)), np.ones((len(windows), joints))
        if samples.velocity_measured:
            lags = lags_of(physics.sensors)
            others = tuple(effect for effect in physics.sensors if effect not in lags)
            as_written = measured
            if lags:
                as_written = corrected_measurement(samples, self.sensors, replace(physics, sensors=others))
            q, v, louder = self._kinematic.compared(lags, physics.tree.joint_names, as_written.q, as_written.v)
            kinematic = windows.rate @ q + windows.velocity @ v
            if samples.estimated is not None:
                # ∫ (t − t̄) a dt of an acceleration that is linear over an interval
                bend = np.diff(samples.time)[:, None] ** 2 / 12.0 * samples.estimated.bend
                kinematic = kinematic - windows.interval @ bend
            kinematic = kinematic * louder
        at_joints = joint_samples_of(samples, measured, samples.v_std)
        rows = MeasuredRows(windows, measured.v, measured.u, measured.wrenches, samples.ramped)
        driven = EffortRows(rows, Mobility(moving) if samples.velocity_measured else None)
        at_points, value = _law_samples(samples, measured, at_joints)
        acting = ForceRows(windows, samples.recording.name, at_points, value, moving)
        places = (moving.q, moving.v)
        if samples.estimated is not None:
            q, v = (np.stack([getattr(joint, name) for joint in at_points], axis=1) for name in ("q", "v"))
            places = (q, v)
        inertial = InertialRows(self._links, moving, measured.v, places, value, as_measured)
        return MotionTerms(measured, rows, at_joints, moving, inertial, kinematic, driven, acting, louder, samples)


def _law_samples(
    samples: Samples, measured: Measurement, at_samples: tuple[JointSamples, ...]
) -> tuple[tuple[JointSamples, ...], sp.csr_matrix]:
    """Each joint's motion where its laws are integrated, and the matrix (M, P) of ∫ w f dt from values there.

    Between samples, positions and velocities that agree tell the motion. Corrected for other sensor effects than those
    that it was estimated under, they may not, as with a bias of the velocity alone: what that changes is linear there.
    """
    if samples.estimated is None:
        return at_samples, samples.windows.value
    estimated, at_points = samples.estimated, []
    points = estimated.points
    moved_q, moved_v = points.between(measured.q - estimated.q), points.between(measured.v - estimated.v)
    for j, ramped in enumerate(samples.ramped):
        motion = estimated.q[:, j], estimated.v[:, j], measured.u[:, j], estimated.v_std[:, j]
        found = points.samples(samples.time, *motion, ramped)
        at_points.append(replace(found, q=found.q + moved_q[:, j], v=found.v + moved_v[:, j]))
    return tuple(at_points), points.value
