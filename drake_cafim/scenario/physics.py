"""The forces on the robot along a motion, of the nominal model and of effects, for all samples at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.inverses import inverses
from drake_cafim.dynamics.motion import Motion, bias_force, equations_of_motion, momentum_balance, motion
from drake_cafim.dynamics.touching import sphere_wrenches
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.bristle import bristle_after, bristle_along
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array, Indices


@dataclass(frozen=True)
class FreeResponse:
    """The rigid robot along a motion: mobility M⁻¹ (N, n, n), rotors included, and the bias force (N, n).

    M v̇ + bias = u: the bias is the effort at which v̇ = 0.
    """

    moving: Motion
    mobility: Array
    bias: Array


@dataclass(frozen=True)
class Physics:
    """The physics of a robot: its tree, gravity (3,) m/s² in world axes, contacts, and effects with their values."""

    tree: Tree
    gravity: Array
    contacts: tuple[SphereContact, ...] = ()
    joint_forces: tuple[JointForce, ...] = ()
    actuators: tuple[ActuatorEffect, ...] = ()
    sensors: tuple[SensorEffect, ...] = ()
    couplings: tuple[JointCoupling, ...] = ()
    body_forces: tuple[BodyForce, ...] = ()
    servos: tuple[Servo, ...] = ()
    """The position servos as the scenario states them; `servo_at` includes their effects."""
    servo_effects: tuple[ServoEffect, ...] = ()

    @cached_property
    def rotor_inertias(self) -> Array:
        """Reflected rotor inertia of each joint (n,), with those of joints that follow it, kg m² or kg."""
        return np.array([joint.rotor_inertia for joint in self.tree.moving]) @ self.tree.following[0] ** 2

    @cached_property
    def spheres(self) -> tuple[Indices, Array, Array] | None:
        """The contacts as arrays for `sphere_wrenches`: joints (C,), places (C, 10), laws (C, 10).

        None where an effect changes one of the contacts, whose law is then no longer one of numbers alone.
        """
        numbers = [found for contact in self.contacts if (found := contact.numbers) is not None]
        if len(numbers) < len(self.contacts):
            return None
        places, laws = (np.array([found[k] for found in numbers]).reshape(-1, 10) for k in range(2))
        return np.array([contact.joint for contact in self.contacts], dtype=np.int64), places, laws

    @property
    def effort_gains(self) -> Array:
        """The product of the gains of each joint's actuator effects, (n,)."""
        gains = np.ones(len(self.tree.joints))
        for effect in self.actuators:
            gains[self.tree.joint_index(effect.at)] *= effect.gain
        return gains

    def servo_at(self, joint: str) -> Servo:
        """The servo at `joint`, its effects included."""
        servo = next(servo for servo in self.servos if servo.joint == joint)
        for effect in self.servo_effects:
            if effect.at == joint:
                servo = effect.of(servo)
        return servo

    def bounds_servo(self, law: JointForce) -> bool:
        """Whether the law bounds the effort of a servo directly, with no actuator effect in between."""
        driven = any(servo.joint == law.at for servo in self.servos)
        return law.bounds_effort and driven and not any(effect.at == law.at for effect in self.actuators)

    def bounded_servo_at(self, joint: str) -> Servo:
        """`servo_at` within the bounds of its effort; of what is within them, the law that has them takes nothing."""
        servo = self.servo_at(joint)
        for law in self.joint_forces:
            if law.at == joint and self.bounds_servo(law):
                servo = law.bounded(servo)
        return servo

    @cached_property
    def servo_numbers(self) -> tuple[Indices, Array]:
        """The joints (m,) that servos drive, and (m, 7) the numbers of these, as `drive_servos` takes them."""
        servos = [self.servo_at(servo.joint) for servo in self.servos]
        joints = np.array([self.tree.joint_index(own.joint) for own in servos], dtype=np.int64)
        return joints, np.array([own.numbers for own in servos], dtype=float).reshape(-1, 7)

    @property
    def depends_on_load(self) -> bool:
        """Whether a joint's force depends on the load from outside."""
        return any(effect.values.get("external", 0.0) > 0.0 for effect in self.joint_forces)

    def loads(self, q: Array, memory: Array | None = None) -> Array:
        """(N, n) the efforts by gravity and contacts at the joints, at rest at the positions `q` (N, n)."""
        resting = motion(self.tree, q, np.zeros_like(q))
        load = -bias_force(resting, self.gravity)
        if self.contacts:
            load = load + resting.project(self.contact_wrenches(resting, memory))
        return np.asarray(load, dtype=float)

    @cached_property
    def dampings(self) -> Array:
        """Viscous damping of each joint (n,), with that of joints that follow it, N m s/rad or N s/m."""
        return np.array([joint.damping for joint in self.tree.moving]) @ self.tree.following[0] ** 2

    def momentum_and_force(self, moving: Motion) -> tuple[Array, Array]:
        """Generalized momentum p = M v, rotors included, and ∂T/∂q + gravity, a part of ṗ; each (N, n)."""
        balance = momentum_balance(moving, self.gravity)
        return balance.momentum + self.rotor_inertias * moving.v, balance.force

    def applied_at_joints(self, joints: Sequence[JointSamples]) -> tuple[Array, Array, Array]:
        """Forces at the joints by damping and joint effects, and their derivatives by q and by v, each (N, n).

        `joints` are the samples of each joint in the tree's order.
        """
        v = np.stack([joint.v for joint in joints], axis=1)
        value = -self.dampings * v
        d_q, d_v = np.zeros_like(v), np.broadcast_to(-self.dampings, v.shape).copy()
        for effect in self.joint_forces:
            j = self.tree.joint_index(effect.at)
            law = effect.force(joints[j])
            value[:, j] += law.value
            d_q[:, j] += law.d_q
            d_v[:, j] += law.d_v
        return value, d_q, d_v

    def applied_along_motion(self, joints: Sequence[JointSamples]) -> tuple[Array, Array, Array]:
        """As `applied_at_joints`, the slopes by q without those of friction that builds up, which last for a moment.

        About a motion that is not known yet such a slope, as stiff as the way is short, is taken for that of a spring.
        """
        value, d_q, d_v = self.applied_at_joints(joints)
        for effect in self.joint_forces:
            if effect.slip is not None:
                d_q[:, self.tree.joint_index(effect.at)] -= self.joint_force(effect, joints).d_q
        return value, d_q, d_v

    def joint_force(self, effect: JointForce, joints: Sequence[JointSamples]) -> Force:
        """The force of one effect on the samples of its joint."""
        return effect.force(joints[self.tree.joint_index(effect.at)])

    def contact_memory(self, time: Array, smooth: Motion, moving: Motion) -> Array:
        """The internal states (N, m) of the contacts at samples at `time` (N,) s, integrated over the samples before.

        They are integrated along the motion `smooth`, and belong to the forces on the motion `moving`.
        """
        parts = [
            contact.recall(time, contact.touch(smooth), contact.touch(moving))
            for contact in self.contacts
            if contact.memory
        ]
        return np.concatenate([np.zeros((len(time), 0)), *parts], axis=1)

    @cached_property
    def bristles(self) -> tuple[tuple[int, float], ...]:
        """The joints at which a friction builds up, each with the displacement, rad or m, over which it does."""
        laws = {(self.tree.joint_index(law.at), law.slip) for law in self.joint_forces if law.slip is not None}
        return tuple(sorted(laws))

    def bristles_along(self, q: Array) -> Array:
        """(N, b) the states of `bristles` along the positions `q` (N, n) of one recording."""
        states = [bristle_along(q[:, joint], slip) for joint, slip in self.bristles]
        return np.stack(states, axis=1) if states else np.zeros((len(q), 0))

    def bristles_after(self, memory: Array, displacement: Array) -> Array:
        """The `memory` (B, m), whose last columns are the states of `bristles`, after `displacement` (B, n)."""
        after, first = memory.copy(), memory.shape[1] - len(self.bristles)
        for column, (joint, slip) in enumerate(self.bristles, first):
            after[:, column] = bristle_after(memory[:, column], displacement[:, joint], slip)
        return after

    def contact_wrenches(self, moving: Motion, memory: Array | None = None) -> Array:
        """Wrenches (N, n, 6) that contacts exert on the links, about the world origin in world axes, moment first.

        `memory` (N, m) holds the contacts' internal states as `contact_memory` gives them; None means none.
        """
        if self.spheres is not None:
            return np.asarray(sphere_wrenches(moving.R_WJ, moving.p_WJ, moving.velocities, *self.spheres), dtype=float)
        total = moving.no_wrenches
        start = 0
        for contact in self.contacts:
            own = None if memory is None else memory[:, start : start + contact.memory]
            total[:, contact.joint] += contact.wrench(moving, own)
            start += contact.memory
        return total

    def advance_memory(self, memory: Array, moving: Motion, elapsed: Array, left: Array) -> Array:
        """The contacts' internal states (B, m) after `elapsed` (B,) s, from `memory` (B, m), along the motion `moving`.

        `left` (B,) s of the time come after the instant of `moving`.
        """
        parts, start = [np.zeros((len(elapsed), 0))], 0
        for contact in self.contacts:
            if contact.memory:
                own = memory[:, start : start + contact.memory]
                parts.append(contact.ahead(own, contact.touch(moving), elapsed, left))
            start += contact.memory
        # of friction at the joints, see `bristles_after`
        return np.concatenate([*parts, memory[:, start:]], axis=1)

    def body_wrenches(self, moving: Motion, time: Array | None = None, recording: str | None = None) -> Array:
        """Wrenches (N, n, 6) of body forces on the links, about the world origin in world axes, moment first.

        `time` (N,) s and the name of the `recording` matter to forces that act in an interval of one recording only.
        """
        total = moving.no_wrenches
        for effect in self.body_forces:
            body = self.tree.body(effect.at)
            p_WP, v_WP = moving.point(body.joint, body.p_JB + body.R_JB @ effect.point(body))
            force = effect.force(p_WP, v_WP, time, recording, moving.lasting)
            total[:, body.joint] += np.concatenate([cross(p_WP, force), force], axis=1)
        return total

    def free_response(self, moving: Motion) -> FreeResponse:
        """Mobility and bias force of the rigid robot along a motion."""
        M, bias = equations_of_motion(moving, self.gravity)
        mobility = inverses(M + np.diag(self.rotor_inertias))
        return FreeResponse(moving, mobility, bias)

    def rotor_drives(
        self, time: Array, response: FreeResponse, effort: Array, joints: Sequence[JointSamples]
    ) -> tuple[RotorDrive, ...]:
        """For each joint, g and m of ψ̈ = g − m f, with ψ the twist of rotor against link and f the law between them.

        All other joints keep rigid transmissions. `effort` (N, n) acts from each of `time` (N,) s to the next. With
        A = M⁻¹ of the rigid robot and a its diagonal element, removing the rotor inertia J of a joint from its link
        gives the mobility b = a/(1 − J a) (Sherman, Morrison), and m = 1/J + b.
        """
        moving, A = response.moving, response.mobility
        force = self.applied_at_joints(joints)[0] - response.bias
        if self.contacts:
            force = force + moving.project(self.contact_wrenches(moving, self.contact_memory(time, moving, moving)))
        if self.body_forces:
            force = force + moving.project(self.body_wrenches(moving))
        # Efforts are constant within an interval, all else is smooth: the mean of both ends is exact to second order.
        A, drift = _interval_means(A), _interval_means(np.einsum("nij,nj->ni", A, force))
        own = np.diagonal(A, axis1=1, axis2=2)
        drives = []
        for j, inertia in enumerate(joint.rotor_inertia for joint in self.tree.joints):
            if inertia <= 0.0:
                drives.append(RotorDrive(time, np.zeros(len(time)), np.ones(len(time)), 0.0))
                continue
            without = drift[:, j] + np.einsum("ni,ni->n", A[:, j], effort) - own[:, j] * effort[:, j]
            free = 1.0 - inertia * own[:, j]
            push = effort[:, j] / inertia - without / free
            drives.append(RotorDrive(time, push, 1.0 / inertia + own[:, j] / free, float(inertia)))
        return tuple(drives)

    def with_effects(self, effects: Sequence[Effect]) -> "Physics":
        """The physics with `effects`, which have their values, added to it."""
        physics = self
        for effect in effects:
            physics = effect.add_to(physics)
        return physics

    def with_part(self, part: str, effect: Effect) -> "Physics":
        """The physics with `effect` appended to the field `part`, as "joint_forces"."""
        return self.changed(**{part: (*getattr(self, part), effect)})

    def changed(self, **parts: Any) -> "Physics":
        """The physics with other values of some fields."""
        return replace(self, **parts)


def _interval_means(values: Array) -> Array:
    """The mean (N, ...) of each sample and the next; the last sample's is its own value."""
    return np.asarray(0.5 * (values + np.concatenate([values[1:], values[-1:]])), dtype=float)
