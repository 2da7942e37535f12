"""The residual of the equations of motion, integrated against test functions (weak form), for one recording.

For each window w and joint k, in exact arithmetic and with the true physics, all of these are zero:

    kinematic   ∫ ẇ q dt + ∫ w v dt
    dynamic     −∫ ẇ p_k dt − ∫ w (∂T/∂q_k + gravity + joint forces + contact + u)_k dt,     p = M(q) v
    wrench      ∫ w (measured − predicted contact wrench) dt

The noise of the samples enters them to first order through the Jacobian of `noise_jacobian`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.rows.contact_terms import ContactTerms
from drake_cafim.diagnosis.rows.coupling_rows import CouplingRows
from drake_cafim.diagnosis.rows.measurement import Measurement
from drake_cafim.diagnosis.rows.motion_terms import MotionTerms, MotionTermsCache
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.rows.sensor_slopes import SensorSlopes
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import Motion
from drake_cafim.effects.effect import Place
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class WeakForm:
    """The weak form of one recording: its samples, and the sensors of contact wrenches."""

    samples: Samples
    sensors: tuple[WrenchSensor, ...]

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

    @cached_property
    def _motion_terms(self) -> MotionTermsCache:
        return MotionTermsCache(self.samples, self.sensors)

    @cached_property
    def couplings(self) -> CouplingRows:
        """The terms of rotors behind elasticity or backlash."""
        return CouplingRows(self._motion_terms)

    @cached_property
    def contacts(self) -> ContactTerms:
        """Contacts, forces on bodies and predicted readings of the wrench sensors."""
        return ContactTerms(self.samples, self.sensors)

    @cached_property
    def sensor_slopes(self) -> SensorSlopes:
        """Derivatives of recorded columns with respect to the strengths of sensor effects."""
        return SensorSlopes(self.samples)

    def forget(self) -> None:
        """Frees what was computed of the samples, which is computed again when it is asked for."""
        for name in ("_motion_terms", "couplings", "contacts", "sensor_slopes"):
            vars(self).pop(name, None)

    def terms(self, physics: Physics) -> MotionTerms:
        """The measurement, motion and the rows' terms of both under the sensor effects of `physics`."""
        return self._motion_terms.of(physics)

    def measurement(self, physics: Physics) -> Measurement:
        """The samples, those of motion and effort corrected for the sensor effects of `physics`."""
        return self.terms(physics).measured

    def motion(self, physics: Physics) -> Motion:
        """The smoothed motion, corrected for the sensor effects of `physics`."""
        return self.terms(physics).moving

    def joint_samples(self, physics: Physics) -> tuple[JointSamples, ...]:
        """The samples at which the force laws of joint effects are evaluated, for each joint."""
        return self.terms(physics).joints

    def law_samples(self, physics: Physics) -> tuple[JointSamples, ...]:
        """Each joint's motion at the points over which its laws are integrated."""
        return self.terms(physics).acting.joints

    def mean_effort(self, physics: Physics) -> Array:
        """(N, n) mean effort that acts at each joint from one sample to the next, rotor inertia not subtracted."""
        return self.terms(physics).driven.mean_effort(physics)

    def effort_at_samples(self, physics: Physics) -> Array:
        """(N, n) effort that acts at each joint at the samples; of a held one, what acts from there on."""
        return self.terms(physics).driven.at_samples(physics)

    def contact_memory(self, physics: Physics) -> Array:
        """(N, m) states of the contacts at each sample."""
        return self.contacts.memory(physics, self.terms(physics))

    def residual(self, physics: Physics) -> Array:
        """All rows (M, r) of each window: kinematic, dynamic, then each sensor's wrench."""
        return self.rows_beside_contacts(physics) + self.contact_rows(physics)

    def rows_beside_contacts(self, physics: Physics) -> Array:
        """(M, r) the residual without the terms of `contact_rows`."""
        terms = self.terms(physics)
        dynamic = terms.inertial.of(physics.tree, physics.gravity)
        dynamic = dynamic - terms.rows.rate_of_velocity * physics.rotor_inertias
        dynamic = dynamic - _integrate_joint_forces(physics, terms) - terms.driven.integral(physics)
        if physics.body_forces:
            dynamic = dynamic - terms.acting.on_bodies(physics)
        for coupling in physics.couplings:
            dynamic[:, physics.tree.joint_index(coupling.at)] += self.couplings.rows(physics, coupling)
        # divided by the effort gains: otherwise a gain of zero with no motion would fit perfectly
        kinematic = terms.kinematic
        if kinematic.size:
            kinematic = kinematic - terms.driven.steps(physics) * terms.louder
        rows = [kinematic, dynamic / physics.effort_gains]
        return np.concatenate([*rows, *terms.rows.read], axis=1)

    def contact_rows(self, physics: Physics) -> Array:
        """(M, r) the terms of contacts: generalised forces in dynamic rows, predicted readings in wrench rows."""
        moving, windows = self.terms(physics).moving, self.samples.windows
        rows = np.zeros((len(windows), self.rows_per_window))
        wrench = None
        if physics.contacts:
            memory = self.contact_memory(physics)
            rows[:, self.dynamic] = -(self.samples.law_value @ _contact_forces(self, physics, memory))
            rows[:, self.dynamic] /= physics.effort_gains
            wrench = physics.contact_wrenches(moving, memory) if self.sensors else None
        if self.sensors:
            rows[:, self.dynamic.stop :] = -(windows.value @ self.contacts.readings(physics, moving, wrench))
        return rows


def _contact_forces(weak: WeakForm, physics: Physics, memory: Array) -> Array:
    """(P, n) generalised forces of contacts at the points over which laws are integrated."""
    moving, estimated = weak.terms(physics).moving_at_points, weak.samples.estimated
    if estimated is not None:
        memory = estimated.points.between(memory)
    return moving.project(physics.contact_wrenches(moving, memory))


def memory_of(weak: WeakForm, physics: Physics) -> Array:
    """(N, m) states of the contacts and, in the last columns, of friction that builds up with displacements."""
    return np.concatenate([weak.contact_memory(physics), physics.bristles_along(weak.motion(physics).q)], axis=1)


def acting_effort(weak: WeakForm, physics: Physics) -> Array:
    """(N, n) the mean effort, without what force laws of the actuators take off, as a speed limit does."""
    effort, joints = weak.mean_effort(physics).copy(), weak.joint_samples(physics)
    for effect in physics.joint_forces:
        if effect.place is Place.ACTUATOR:
            effort[:, physics.tree.joint_index(effect.at)] += physics.joint_force(effect, joints).value
    return effort


def slope_by_servo(weak: WeakForm, physics: Physics, joint: int, parameter: str) -> Array:
    """The derivative (M, r) of `WeakForm.residual` by the "stiffness" or the "damping" of a joint's servo.

    The servo has no sag, and the joint no actuator effect.
    """
    terms, samples = weak.terms(physics), weak.samples
    rows = np.zeros((len(samples.windows), weak.rows_per_window))
    if joint not in terms.servos:
        return rows
    driven, effort = terms.by_servo(physics, joint, parameter)
    bare = replace(physics, actuators=())
    if weak.kinematic_rows:
        rows[:, : weak.kinematic_rows] = -driven.steps(bare) * terms.louder
    rows[:, weak.dynamic] = -driven.integral(bare)
    at_points = effort if samples.estimated is None else samples.estimated.points.between(effort)
    for effect in physics.joint_forces:
        if effect.at == physics.tree.joint_names[joint]:
            by_effort = effect.force(terms.acting.joints[joint]).d_u
            rows[:, weak.dynamic.start + joint] -= samples.law_value @ (by_effort * at_points)
    rows[:, weak.dynamic] /= physics.effort_gains
    return rows


def _integrate_joint_forces(physics: Physics, terms: MotionTerms) -> Array:
    """∫ w force dt (M, n) of damping and joint effects."""
    integral = -physics.dampings * terms.acting.velocity
    for effect in physics.joint_forces:
        joint = physics.tree.joint_index(effect.at)
        integral[:, joint] += terms.acting.at_joint(effect, joint)
    return np.asarray(integral)
