"""All that the model says acts on the robot, with effects beyond it, over many samples at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.inverses import inverses
from drake_cafim.dynamics.motion import Motion, equations_of_motion, momentum_balance
from drake_cafim.dynamics.touching import pressed
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import Effect, Force, JointSamples
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array, Indices


@dataclass(frozen=True)
class FreeResponse:
    """The rigid robot along a motion: mobility M⁻¹ (N, n, n), and the force (N, n) that keeps v̇ = 0."""

    moving: Motion
    mobility: Array
    bias: Array


@dataclass(frozen=True)
class Physics:
    """A model with numbers: tree, gravity (3,) m/s² world, contacts, and effects with their values."""

    tree: Tree
    gravity: Array
    contacts: tuple[SphereContact, ...] = ()
    joint_forces: tuple[JointForce, ...] = ()
    actuators: tuple[ActuatorEffect, ...] = ()
    sensors: tuple[SensorEffect, ...] = ()
    couplings: tuple[JointCoupling, ...] = ()
    body_forces: tuple[BodyForce, ...] = ()

    @property
    def rotor_inertias(self) -> Array:
        """Reflected rotor inertia of each joint, (n,)."""
        return np.array([joint.rotor_inertia for joint in self.tree.joints])

    @cached_property
    def spheres(self) -> tuple[Indices, Array, Array] | None:
        """The contacts as `pressed` takes them: joints (C,), places (C, 10), laws (C, 7); None where one is changed."""
        numbers = [one for contact in self.contacts if (one := contact.numbers) is not None]
        if len(numbers) < len(self.contacts):
            return None
        places, laws = (np.array([one[k] for one in numbers]).reshape(-1, size) for k, size in ((0, 10), (1, 7)))
        return np.array([contact.joint for contact in self.contacts], dtype=np.int64), places, laws

    @property
    def effort_gains(self) -> Array:
        """What each joint's effort is multiplied by, (n,)."""
        gains = np.ones(len(self.tree.joints))
        for effect in self.actuators:
            gains[self.tree.joint_index(effect.at)] *= effect.gain
        return gains

    @property
    def dampings(self) -> Array:
        """Viscous damping of each joint, (n,)."""
        return np.array([joint.damping for joint in self.tree.joints])

    def momentum_and_force(self, moving: Motion) -> tuple[Array, Array]:
        """Generalized momentum and the rigid-body force, each (N, n): ∂T/∂q and gravity."""
        balance = momentum_balance(moving, self.gravity)
        return balance.momentum + self.rotor_inertias * moving.v, balance.force

    def applied_at_joints(self, joints: Sequence[JointSamples]) -> tuple[Array, Array, Array]:
        """Forces at the joints (N, n) by damping and joint effects, with slopes in q and v (N, n).

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

    def joint_force(self, effect: JointForce, joints: Sequence[JointSamples]) -> Force:
        """One effect's law on the samples of its joint."""
        return effect.force(joints[self.tree.joint_index(effect.at)])

    def contact_memory(self, time: Array, smooth: Motion, moving: Motion) -> Array:
        """(N, m) what the contacts remember at samples at `time` (N,) s of all the samples before each.

        The past is that of the `smooth` motion; what it is for is the force on `moving`.
        """
        parts = [one.recall(time, one.touch(smooth), one.touch(moving)) for one in self.contacts if one.memory]
        return np.concatenate([np.zeros((len(time), 0)), *parts], axis=1)

    def contact_wrenches(self, moving: Motion, memory: Array | None = None) -> Array:
        """(N, n, 6) wrenches that contacts exert on the links, about the world origin, moment first.

        `memory` (N, m) as `contact_memory` has it; without it the contacts remember nothing.
        """
        if self.spheres is not None:
            return np.asarray(pressed(moving.R_WJ, moving.p_WJ, moving.velocities, *self.spheres), dtype=float)
        total = np.zeros((*moving.q.shape, 6))
        start = 0
        for contact in self.contacts:
            own = None if memory is None else memory[:, start : start + contact.memory]
            total[:, contact.joint] += contact.wrench(moving, own)
            start += contact.memory
        return total

    def remembered(self, memory: Array, moving: Motion, elapsed: Array, left: Array) -> Array:
        """The contacts' memory (B, m) `elapsed` (B,) s later, of which `left` (B,) s after a motion on the way."""
        parts, start = [np.zeros((len(elapsed), 0))], 0
        for contact in self.contacts:
            if contact.memory:
                own = memory[:, start : start + contact.memory]
                parts.append(contact.ahead(own, contact.touch(moving), elapsed, left))
            start += contact.memory
        return np.concatenate(parts, axis=1)

    def body_wrenches(self, moving: Motion, time: Array | None = None, recording: str | None = None) -> Array:
        """(N, n, 6) wrenches of body forces on the links, about the world origin, moment first.

        `time` (N,) s and `recording` say when the samples were taken, where they were.
        """
        total = np.zeros((*moving.q.shape, 6))
        for effect in self.body_forces:
            body = self.tree.body(effect.at)
            p_WP, v_WP = moving.point(body.joint, body.p_JB + body.R_JB @ effect.point(body))
            force = effect.force(p_WP, v_WP, time, recording, moving.lasting)
            total[:, body.joint] += np.concatenate([cross(p_WP, force), force], axis=1)
        return total

    def free_response(self, moving: Motion) -> FreeResponse:
        """How the rigid robot would answer to forces along a motion."""
        M, bias = equations_of_motion(moving, self.gravity)
        mobility = inverses(M + np.diag(self.rotor_inertias))
        return FreeResponse(moving, mobility, bias)

    def rotor_drives(
        self, time: Array, response: FreeResponse, effort: Array, joints: Sequence[JointSamples]
    ) -> tuple[RotorDrive, ...]:
        """What would drive each joint's twist if its rotor were coupled to it by a law; the other joints are rigid.

        `effort` (N, n) acts from each of `time` (N,) s to the next. With A = M⁻¹ of the rigid robot, taking the rotor
        J of a joint off its link makes its mobility b = a/(1 − J a), a the diagonal of A (Sherman, Morrison).
        """
        moving, A = response.moving, response.mobility
        force = self.applied_at_joints(joints)[0] - response.bias
        if self.contacts:
            force = force + moving.project(self.contact_wrenches(moving, self.contact_memory(time, moving, moving)))
        if self.body_forces:
            force = force + moving.project(self.body_wrenches(moving))
        # held efforts change at the samples, all else is smooth: taken in the middle of each interval
        A, drift = _in_the_middle(A), _in_the_middle(np.einsum("nij,nj->ni", A, force))
        own = np.diagonal(A, axis1=1, axis2=2)
        drives = []
        for j, inertia in enumerate(self.rotor_inertias):
            if inertia <= 0.0:
                drives.append(RotorDrive(time, np.zeros(len(time)), np.ones(len(time)), 0.0))
                continue
            without = drift[:, j] + np.einsum("ni,ni->n", A[:, j], effort) - own[:, j] * effort[:, j]
            free = 1.0 - inertia * own[:, j]
            push = effort[:, j] / inertia - without / free
            drives.append(RotorDrive(time, push, 1.0 / inertia + own[:, j] / free, float(inertia)))
        return tuple(drives)

    def with_effects(self, effects: Sequence[Effect]) -> "Physics":
        """The physics with more effects, each of which has its values."""
        physics = self
        for effect in effects:
            physics = effect.entered(physics)
        return physics

    def joined(self, part: str, effect: Effect) -> "Physics":
        """With `effect` at the end of one of its parts, as "joint_forces"."""
        return self.changed(**{part: (*getattr(self, part), effect)})

    def changed(self, **parts: Any) -> "Physics":
        """With other parts."""
        return replace(self, **parts)


def _in_the_middle(values: Array) -> Array:
    """Means (N, ...) of each sample and the next."""
    return np.asarray(0.5 * (values + np.concatenate([values[1:], values[-1:]])), dtype=float)
