"""The residual of the equations of motion, integrated against test functions (weak form), for one recording.

For each window w and joint k, in exact arithmetic and with the true physics, all of these are zero:

    kinematic   ∫ ẇ q dt + ∫ w v dt
    dynamic     −∫ ẇ p_k dt − ∫ w (∂T/∂q_k + gravity + joint forces + contact + u)_k dt,     p = M(q) v
    wrench      ∫ w (measured − predicted contact wrench) dt

The noise of the samples enters them to first order through the Jacobian of `noise_jacobian`.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.effort_rows import EffortRows, effort_at
from drake_cafim.diagnosis.rows.force_rows import ForceRows
from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows, lags_of
from drake_cafim.diagnosis.rows.measured_rows import MeasuredRows
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.thresholds import CHANNEL_SMOOTHING_REACH
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.inverses import inverses
from drake_cafim.dynamics.motion import Motion, mass_matrix, motion
from drake_cafim.effects.actuator import ActuatorEffect, Effort
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import JointSamples
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import FreeResponse, Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Measurement:
    """The samples, corrected for sensor effects: `q`, `v`, `u` (N, n), and `wrenches` (N, 6) for each sensor.

    `q_hat`, `v_hat` (N, n) are smoothed; `v_kinked` (N, n) is the velocity at which force laws that may have a kink at
    rest are evaluated.
    """

    q: Array
    v: Array
    u: Array
    q_hat: Array
    v_hat: Array
    v_kinked: Array
    wrenches: tuple[Array, ...]


@dataclass(frozen=True)
class _Prepared:
    """The corrected measurement, its motion, and the rows' terms that follow from them."""

    measured: Measurement
    rows: MeasuredRows
    joints: tuple[JointSamples, ...]
    moving: Motion
    regressor: InertialRegressor
    kinematic: Array
    driven: EffortRows
    acting: ForceRows
    louder: Array
    """(M, n), the factor that scales `kinematic` to the noise that it has without a sensor's lag."""
    in_doubt: dict[tuple[str, float], Array] = field(default_factory=dict, repr=False, compare=False)
    """Cached rows of the unknown initial state of sensors' lags, by the sensor and its time constant."""


@dataclass(frozen=True)
class WeakForm:
    """The weak form of one recording: its samples, and the sensors of contact wrenches."""

    samples: Samples
    sensors: tuple[WrenchSensor, ...]
    _cache: dict[tuple[object, ...], _Prepared] = field(default_factory=dict, repr=False, compare=False)
    _trials: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)
    _changes: dict[tuple[str, str], Array] = field(default_factory=dict, repr=False, compare=False)
    _smooth: list[tuple[_Prepared, Motion]] = field(default_factory=list, repr=False, compare=False)
    _drives: dict[tuple[object, ...], tuple[RotorDrive, ...]] = field(default_factory=dict, repr=False, compare=False)
    _responses: dict[tuple[object, ...], FreeResponse] = field(default_factory=dict, repr=False, compare=False)

    @property
    def joints(self) -> int:
        """The number n of joints."""
        return int(self.samples.q.shape[1])

    @property
    def kinematic_rows(self) -> int:
        """The number of kinematic rows in a window: n where velocities are measured, else 0."""
        return self.joints if self.samples.velocity_measured else 0

    @property
    def rows_per_window(self) -> int:
        """The number r of rows in a window."""
        return self.kinematic_rows + self.joints + 6 * len(self.sensors)

    @property
    def dynamic(self) -> slice:
        """The rows of a window that hold the joints' equations of motion."""
        return slice(self.kinematic_rows, self.kinematic_rows + self.joints)

    def measurement(self, physics: Physics) -> Measurement:
        """The samples, those of motion and effort corrected for the sensor effects of `physics`."""
        return self._prepared(physics).measured

    @cached_property
    def _kinematic(self) -> KinematicRows:
        return KinematicRows(self.samples)

    @cached_property
    def _links(self) -> LinkRegressors:
        return LinkRegressors(self.samples.windows)

    def louder(self, physics: Physics) -> Array:
        """The noise factor (M, n) of `KinematicRows.compared`."""
        return self._prepared(physics).louder

    def in_doubt(self, physics: Physics) -> dict[tuple[str, float], Array]:
        """The cache of rows for the initial state of sensors' lags under the sensor effects of `physics`."""
        return self._prepared(physics).in_doubt

    def motion(self, physics: Physics) -> Motion:
        """The smoothed motion, corrected for the sensor effects of `physics`."""
        return self._prepared(physics).moving

    def _measured(self, physics: Physics) -> Measurement:
        s = self.samples
        names = physics.tree.joint_names
        columns = {
            f"{kind}.{name}": values[:, j]
            for kind, values in (("q", s.q), ("v", s.v), ("u", s.u))
            for j, name in enumerate(names)
        }
        columns |= {
            f"wrench.{sensor.name}.{axis}": s.wrenches[i][:, k]
            for i, sensor in enumerate(self.sensors)
            for k, axis in enumerate(WRENCH_COMPONENTS)
        }
        for effect in physics.sensors:
            on = tuple(name for name in effect.channels(tuple(columns)) if not name.startswith("wrench."))
            if not on:
                continue
            true = effect.true(s.time, np.stack([columns[name] for name in on], axis=1))
            columns |= {name: true[:, k] for k, name in enumerate(on)}
        q = np.stack([columns[f"q.{name}"] for name in names], axis=1)
        u = np.stack([columns[f"u.{name}"] for name in names], axis=1)
        v = (
            s.differentiate @ q
            if s.differentiate is not None
            else np.stack([columns[f"v.{name}"] for name in names], axis=1)
        )
        wrenches = tuple(
            np.stack([columns[f"wrench.{sensor.name}.{a}"] for a in WRENCH_COMPONENTS], axis=1)
            for sensor in self.sensors
        )
        v_hat, v_kinked = (
            np.stack([smoother.of(q[:, j], v[:, j]) for j, smoother in enumerate(smoothers)], axis=1)
            for smoothers in (s.smooth_v, s.kinked_v)
        )
        return Measurement(q, v, u, s.smooth_q @ q, v_hat, v_kinked, wrenches)

    def joint_samples(self, physics: Physics) -> tuple[JointSamples, ...]:
        """The samples at which the force laws of joint effects are evaluated, for each joint."""
        return self._prepared(physics).joints

    def sampled_joints(self, measured: Measurement, v_std: Array) -> tuple[JointSamples, ...]:
        """`joint_samples` of a measurement whose velocities have the standard deviation `v_std` (N, n).

        A held effort has two values at a sample; with their mean, the trapezoid rule integrates it as a staircase.
        A ramped effort has the recorded value.
        A sample represents an interval in which v changes by D: the mean of sign(v) over it has the slope 2/D at
        v = 0, as if v had an error of standard deviation D/√(2π), which is added to `v_std`.
        """
        mean = 0.5 * (measured.u + np.concatenate([measured.u[:1], measured.u[:-1]]))
        u = np.where(self.samples.ramped, measured.u, mean)
        v_std = np.sqrt(v_std**2 + np.gradient(measured.v_kinked, axis=0) ** 2 / (2.0 * np.pi))
        q_reach = 0.5 * np.abs(np.gradient(measured.q_hat, axis=0))
        columns = (measured.q_hat, measured.v_kinked, u, v_std, q_reach)
        return tuple(JointSamples(*(np.ascontiguousarray(c[:, j]) for c in columns)) for j in range(self.joints))

    def effort(self, physics: Physics, joint: int, u: Array) -> Effort:
        """The effort that acts at `joint` when `u` (N, n) is commanded."""
        return effort_at(physics, joint, Effort(self.samples.time, u[:, joint], self.samples.ramped[joint]))

    def asked(self, physics: Physics) -> Array:
        """∫ w u dt (M, n) of the commanded efforts."""
        return self._prepared(physics).rows.asked

    def mean_effort(self, physics: Physics) -> Array:
        """(N, n) mean effort that acts at each joint from one sample to the next, rotor inertia not subtracted."""
        acting = self.measurement(physics).u.copy()
        driven = {physics.tree.joint_index(effect.at) for effect in physics.actuators}
        for j in driven | set(np.flatnonzero(self.samples.ramped).tolist()):
            acting[:, j] = self.effort(physics, j, acting).means(self.samples.time)
        return acting

    def std_behind(self, physics: Physics, lag: ActuatorEffect) -> float:
        """Standard deviation over time of the commanded effort less the effort that acts under `lag`, N m or N."""
        return self._prepared(physics).driven.std_behind(physics, lag)

    def _at_joints(self, physics: Physics, prepared: "_Prepared") -> Array:
        """∫ w force dt (M, n) of damping and joint effects."""
        integral = -physics.dampings * prepared.rows.smoothed_velocity
        for effect in physics.joint_forces:
            joint = physics.tree.joint_index(effect.at)
            integral[:, joint] += prepared.acting.at_joint(effect, joint)
        return np.asarray(integral)

    def rotor_drives(self, physics: Physics) -> tuple[RotorDrive, ...]:
        """The excitation of each joint's twist between rotor and link.

        Cached for the last physics, whatever its couplings are, since the excitation does not depend on them.
        """
        effects = (*physics.joint_forces, *physics.actuators, *physics.sensors, *physics.body_forces)
        inertial = (
            physics.tree.inertial_parameters.tobytes(),
            physics.gravity.tobytes(),
            physics.rotor_inertias.tobytes(),
            *((effect.key, *effect.values.values()) for effect in physics.sensors),
        )
        key = (
            *inertial,
            physics.dampings.tobytes(),
            *((effect.key, *effect.values.values()) for effect in effects),
            *((contact.name, str(contact)) for contact in physics.contacts),
        )
        if key not in self._drives:
            self._drives.clear()
            prepared, time = self._prepared(physics), self.samples.time
            if inertial not in self._responses:
                self._responses.clear()
                # the inertial parameters may differ from those that the motion was prepared with
                self._responses[inertial] = physics.free_response(replace(prepared.moving, tree=physics.tree))
            self._drives[key] = physics.rotor_drives(
                time, self._responses[inertial], self.mean_effort(physics), prepared.joints
            )
        return self._drives[key]

    def coupling_rows(self, physics: Physics, coupling: JointCoupling) -> Array:
        """(M,) the term of a coupling in its joint's dynamic row: −∫ ẇ J ψ̇ dt, rotor inertia J, twist ψ."""
        drive = self.rotor_drives(physics)[physics.tree.joint_index(coupling.at)]
        return np.asarray(-drive.inertia * (self.samples.windows.rate @ coupling.twist_rate(drive)), dtype=float)

    def trial_rows(self, physics: Physics, trial: JointCoupling) -> Array:
        """`coupling_rows` (M,) of a value for screening, computed under the first physics and reused for later ones.

        A rotor's motion takes long to simulate, and screening need not be exact.
        """
        key = (*trial.key, *trial.values.values())
        if key not in self._trials:
            self._trials[key] = self.coupling_rows(physics, trial)
        return self._trials[key]

    @cached_property
    def _smooth_channel(self) -> sp.csr_matrix:
        return local_polynomial(self.samples.time, CHANNEL_SMOOTHING_REACH, 3, 0, at_least=4)

    def sensor_change(self, effect: SensorEffect, columns: tuple[str, ...]) -> Array:
        """Derivatives (N, c, k) of the c `columns` that `effect` acts on with respect to its k strengths.

        The columns are smoothed over more than a window first: regressors that contain the rows' own noise would bias
        the fitted strengths (errors in variables).
        """
        if effect.key not in self._changes:
            recording = self.samples.recording
            written = np.nan_to_num(np.stack([recording[name] for name in columns], axis=1))
            self._changes[effect.key] = effect.columns(self.samples.time, self._smooth_channel @ written)
        return self._changes[effect.key]

    def residual(self, physics: Physics) -> Array:
        """All rows (M, r) of each window: kinematic, dynamic, then each sensor's wrench."""
        prepared = self._prepared(physics)
        dynamic = prepared.regressor.rows(physics.tree.inertial_parameters, physics.gravity)
        dynamic = dynamic - prepared.rows.rate_of_velocity * physics.rotor_inertias
        dynamic = dynamic - self._at_joints(physics, prepared) - prepared.driven.integral(physics)
        if physics.body_forces:
            dynamic = dynamic - prepared.acting.on_bodies(physics)
        for coupling in physics.couplings:
            dynamic[:, physics.tree.joint_index(coupling.at)] += self.coupling_rows(physics, coupling)
        # divided by the effort gains: otherwise a gain of zero with no motion would fit perfectly
        kinematic = prepared.kinematic
        if physics.actuators and kinematic.size:
            kinematic = kinematic - prepared.driven.steps(physics) * prepared.louder
        rows = [kinematic, dynamic / physics.effort_gains]
        return np.concatenate([*rows, *prepared.rows.read], axis=1) + self.contact_rows(physics)

    def contact_rows(self, physics: Physics) -> Array:
        """(M, r) the terms of contacts: generalised forces in dynamic rows, predicted readings in wrench rows."""
        moving, windows = self._prepared(physics).moving, self.samples.windows
        rows = np.zeros((len(windows), self.rows_per_window))
        wrench = None
        if physics.contacts:
            wrench = physics.contact_wrenches(moving, self.contact_memory(physics))
            rows[:, self.dynamic] = -(windows.value @ moving.project(wrench)) / physics.effort_gains
        if self.sensors:
            rows[:, self.dynamic.stop :] = -(windows.value @ self._readings(physics, moving, wrench))
        return rows

    def written(self, physics: Physics, moving: Motion, memory: Array) -> Array:
        """Predicted readings (N, 6 s) of s wrench sensors along a motion; `memory` (N, m) are the contact states."""
        return self._readings(physics, moving, physics.contact_wrenches(moving, memory) if physics.contacts else None)

    def _readings(self, physics: Physics, moving: Motion, wrench: Array | None) -> Array:
        """Predicted readings (N, 6 s), sensor effects included, for the links' wrenches (N, n, 6); None: no contact."""
        exact = [sensor.reading(moving, self._on(sensor, moving, wrench)) for sensor in self.sensors]
        written = [self._written(physics, sensor, reading) for sensor, reading in zip(self.sensors, exact, strict=True)]
        return np.concatenate([np.zeros((len(moving.q), 0)), *written], axis=1)

    def contact_memory(self, physics: Physics) -> Array:
        """(N, m) states of the contacts at each sample, along the adaptively smoothed motion (`Samples.tracks`)."""
        if not any(contact.memory for contact in physics.contacts):
            return np.zeros((len(self.samples.time), 0))
        prepared = self._prepared(physics)
        return physics.contact_memory(self.samples.time, self._smooth_motion(prepared), prepared.moving)

    def _smooth_motion(self, prepared: "_Prepared") -> Motion:
        """The motion for contact states, from positions and velocities together; cached for the last measurement."""
        if not self._smooth or self._smooth[0][0] is not prepared:
            s, measured = self.samples, prepared.measured
            columns = [track.of(measured.q[:, j], measured.v[:, j]) for j, track in enumerate(s.tracks)]
            smooth = motion(prepared.moving.tree, np.stack(columns, axis=1), measured.v_hat)
            self._smooth[:] = [(prepared, smooth)]
        return self._smooth[0][1]

    def _written(self, physics: Physics, sensor: WrenchSensor, reading: Array) -> Array:
        """The sensor's output (N, 6) for the exact `reading` (N, 6) under the sensor effects of `physics`.

        The prediction is changed, rather than the measurement corrected, so that the measured noise stays as it is.
        """
        names = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_COMPONENTS]
        for effect in physics.sensors:
            on = [names.index(name) for name in effect.channels(names)]
            if on:
                reading = reading.copy()
                reading[:, on] = effect.measured(self.samples.time, reading[:, on])
        return reading

    def _prepared(self, physics: Physics) -> "_Prepared":
        """All that depends on the sensor effects of motion and effort alone, cached for the last few of them."""
        key = tuple(
            (effect.key, *effect.values.values()) for effect in physics.sensors if not effect.at.startswith("wrench.")
        )
        if key not in self._cache:
            make_room(self._cache, 4)
            self._cache[key] = self._prepare(physics)
        return self._cache[key]

    def _prepare(self, physics: Physics) -> "_Prepared":
        measured = self._measured(physics)
        windows = self.samples.windows
        moving = replace(motion(physics.tree, measured.q_hat, measured.v_hat), lasting=np.gradient(self.samples.time))
        kinematic, louder = np.zeros((len(windows), 0)), np.ones((len(windows), self.joints))
        inverse_mass: Array = np.zeros((0, self.joints, self.joints))
        if self.samples.velocity_measured:
            inverse_mass = inverses(mass_matrix(moving) + np.diag(physics.rotor_inertias))
            correction = self._correction_of_efforts(inverse_mass, measured.u)
            lags = lags_of(physics.sensors)
            others = tuple(effect for effect in physics.sensors if effect not in lags)
            as_written = self._measured(replace(physics, sensors=others)) if lags else measured
            q, v, louder = self._kinematic.compared(lags, physics.tree.joint_names, as_written.q, as_written.v)
            kinematic = (windows.rate @ q + windows.value @ v - correction) * louder
        joints = self.sampled_joints(measured, self.samples.v_std)
        regressor = self._links.regressor(moving, measured.v)
        rows = MeasuredRows(windows, measured.v, measured.u, measured.v_hat, measured.wrenches, self.samples.ramped)
        driven = EffortRows(rows, inverse_mass)
        acting = ForceRows(windows, self.samples.recording.name, joints, moving)
        return _Prepared(measured, rows, joints, moving, regressor, kinematic, driven, acting, louder)

    def _correction_of_efforts(self, inverse_mass: Array, u: Array) -> Array:
        """(M, n) correction of the kinematic rows for the steps of v̇ that efforts `u` (N, n) cause, M⁻¹ u."""
        time, ramped = self.samples.time, np.array(self.samples.ramped)
        total = np.zeros((len(self.samples.windows), self.joints))
        for ramp in set(self.samples.ramped):
            acceleration = (inverse_mass @ np.where(ramped == ramp, u, 0.0)[..., None])[..., 0]
            total += self.samples.windows.steps(time, ramp) @ acceleration
        return total

    def _on(self, sensor: WrenchSensor, moving: Motion, wrench: Array | None) -> Array:
        return np.zeros((len(moving.q), 6)) if wrench is None else wrench[:, sensor.joint]

    def _pushed(self, physics: Physics, moving: Motion) -> Array:
        """Generalised forces (N, n) of the forces on bodies."""
        return moving.project(physics.body_wrenches(moving, self.samples.time, self.samples.recording.name))

    def touched_and_pushed(self, physics: Physics, moving: Motion, memory: Array) -> Array:
        """Generalised forces of contacts and of forces on bodies, then undelayed sensor readings, (N, n + 6 s).

        `memory` (N, m) are the contact states.
        """
        wrench = physics.contact_wrenches(moving, memory) if physics.contacts else None
        force = np.zeros_like(moving.q) if wrench is None else moving.project(wrench)
        if physics.body_forces:
            force = force + self._pushed(physics, moving)
        return np.concatenate([force, self.written_at_once(physics, moving, wrench)], axis=1)

    def written_at_once(self, physics: Physics, moving: Motion, wrench: Array | None) -> Array:
        """Readings (N, 6 s) for the links' wrenches (N, n, 6), without the sensor effects that delay them."""
        prompt = replace(physics, sensors=tuple(effect for effect in physics.sensors if not effect.late))
        return self._readings(prompt, moving, wrench)
