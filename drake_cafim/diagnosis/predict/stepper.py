"""Time stepping of many simulations of a model at once, open loop in the efforts, closed through position servos."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.predict.servo_input import ServoInput
from drake_cafim.dynamics.motion import Motion, equations_of_motion, motion
from drake_cafim.dynamics.stepping import integrate
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.joint_samples import Force, JointSamples, joined_forces
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

LONGEST_STEP, LONGEST_CONTACT_STEP = 2e-3, 5e-4
"""s, without and with contact: contact springs are explicit in the steps, so that stiff ones bound the step."""


VelocityWith = Callable[[Array, Array], Array]
"""Velocities (B, n) after a step, from the joint laws (B, n) and their slopes (B, n) in v."""


@dataclass(frozen=True)
class State:
    """Positions and velocities (B, n) of B simulations, and their internal states `memory` (B, m), if any.

    These are of the contacts, then of friction that builds up with displacements (`Physics.bristles`).
    """

    q: Array
    v: Array
    memory: Array | None = None


def step(physics: Physics, state: State, effort: Array, duration: Array, servo: ServoInput | None = None) -> State:
    """The state after one step of `duration` h (B,) s under the constant `effort` u (B, n).

    The linearly implicit midpoint rule, of second order,

        (M − ½ h ∂f/∂v) Δv = h (u + f + Jᵀ F − c),   q₊ = q + h (v + ½ Δv),   v₊ = v + Δv,

    with M and the joint laws f at q + ½ h v and v, and c and the contact and body forces F at v + ½ Δv, where Δv is
    that of F and c at v. The slopes of the joint laws in v are implicit, so that stiff friction is stable (Hairer,
    Wanner, Solving Ordinary Differential Equations II, 1996, IV.7). The efforts of a `servo` are added to u, with their
    slopes in q and v implicit, too.
    """
    h = duration[:, None]
    q_middle = state.q + 0.5 * h * state.v
    moving = motion(physics.tree, q_middle, state.v)
    M, bias = equations_of_motion(moving, physics.gravity)
    M = M + np.diag(physics.rotor_inertias)
    effort, by_servo = _driven(physics, servo, q_middle, state.v, effort, duration)
    joints = _joints(physics, q_middle, state, effort, duration)
    law, _, slope = physics.applied_at_joints(joints)
    slope = slope + by_servo * (1.0 + law_by_effort(physics, joints))
    push, memory = pushed(physics, moving, state.memory, duration)
    diagonal = np.arange(M.shape[1])

    def velocity_with(law: Array, slope: Array) -> Array:
        implicit, force = M.copy(), effort + law - bias + push
        implicit[:, diagonal, diagonal] -= 0.5 * h * slope
        return np.asarray(state.v + np.linalg.solve(implicit, (h * force)[..., None])[..., 0], dtype=float)

    moving = motion(physics.tree, q_middle, 0.5 * (state.v + velocity_with(law, slope)))
    _, bias = equations_of_motion(moving, physics.gravity)
    push, memory = pushed(physics, moving, state.memory, duration)
    after = velocity_with(law, slope)
    turning = _Turning.of((physics,), joints, after)
    if turning is not None:
        after = turning.after(velocity_with, law, slope, physics.dampings)
    return _moved(physics, state, h, after, memory)


def pushed(physics: Physics, moving: Motion, memory: Array | None, duration: Array) -> tuple[Array, Array | None]:
    """Generalized contact and body forces (B, n) in the middle of a step of `duration` (B,) s that moves as `moving`.

    And the contacts' `memory` (B, m) at its end, which it is at its beginning.
    """
    push = np.zeros_like(moving.q)
    if memory is not None and memory.shape[1] > len(physics.bristles):
        halfway = physics.advance_memory(memory, moving, 0.5 * duration, 0.0 * duration)
        push = moving.project(physics.contact_wrenches(moving, halfway))
        memory = physics.advance_memory(memory, moving, duration, 0.5 * duration)
    elif physics.contacts:
        push = moving.project(physics.contact_wrenches(moving))
    if physics.body_forces:
        push = push + moving.project(physics.body_wrenches(moving))
    return push, memory


@dataclass(frozen=True)
class _Turning:
    """Joints that a step takes through rest: `turned` (B, n), and how much of the step, `share` (B, n), is before it.

    `v` (B, n) are the velocities at the step's beginning, `slope` (B, n) the slope of the joint laws there, and
    `change` (B, n) is f(−v) − f(v), N m or N.
    """

    turned: Flags
    share: Array
    v: Array
    slope: Array
    change: Array

    @classmethod
    def of(cls, each: Sequence[Physics], joints: Sequence[JointSamples], after: Array) -> "_Turning | None":
        """What a step that ends with the velocities `after` (B, n) takes through rest; None where it is nothing."""
        v, own = np.stack([joint.v for joint in joints], axis=1), _joints_with_laws(each[0])
        lawful = np.zeros(v.shape[1], dtype=bool)
        lawful[own] = True
        turned = (v * after < 0.0) & lawful
        if not np.any(turned):
            return None
        share = np.divide(v, v - after, where=turned, out=np.ones_like(v))
        slope, change = np.zeros_like(v), np.zeros_like(v)
        for number, j in enumerate(own):
            if np.any(turned[:, j]):
                here, back = (_law(each, number, joint) for joint in (joints[j], replace(joints[j], v=-joints[j].v)))
                slope[:, j] += np.where(turned[:, j], here.d_v, 0.0)
                change[:, j] += np.where(turned[:, j], back.value - here.value, 0.0)
        return cls(turned, share, v, slope, change)

    def after(self, velocity_with: VelocityWith, law: Array, slope: Array, dampings: Array) -> Array:
        """The velocities (B, n) after the step.

        A joint that slides on has f(v) before it rests and f(−v) after, each for its share of the step. Dry friction
        that holds it does so with any force up to its own, which its slope at v ≠ 0 does not tell: twice the secant
        (f(v) − f(−v))/2v in the midpoint rule is the implicit Euler rule, by which a force that opposes the motion does
        not turn it round.
        """
        onward = velocity_with(law + (1.0 - self.share) * self.change, slope - self.slope)
        held = np.any(self.turned & (onward * self.v >= 0.0), axis=1)
        if not np.any(held):
            return onward
        secant = np.divide(-self.change, self.v, where=self.turned, out=np.zeros_like(self.v))
        stopped = velocity_with(law, np.minimum(slope, np.minimum(secant, 0.0) - dampings))
        return np.where(held[:, None], stopped, onward)


def _joints(physics: Physics, q: Array, state: State, effort: Array, duration: Array) -> list[JointSamples]:
    """The samples at which joint laws are evaluated, from q (B, n) in the middle of a step and acting efforts."""
    v, load = state.v, physics.loads(q) if physics.depends_on_load else np.zeros_like(q)
    bent: dict[int, dict[float, Array]] = {}
    if physics.bristles:
        halfway = physics.bristles_after(_memory(physics, state), 0.5 * duration[:, None] * v)
        for (joint, slip), z in zip(physics.bristles, halfway.T[-len(physics.bristles) :], strict=True):
            bent.setdefault(joint, {})[slip] = z
    return [
        JointSamples(q[:, j], v[:, j], effort[:, j], load=load[:, j], bristles=bent.get(j)) for j in range(q.shape[1])
    ]


def _memory(physics: Physics, state: State) -> Array:
    return np.zeros((len(state.q), len(physics.bristles))) if state.memory is None else state.memory


def _moved(physics: Physics, state: State, h: Array, after: Array, memory: Array | None) -> State:
    """The state at the end of a step of `h` (B, 1) s that ends with the velocities `after` (B, n)."""
    moved = 0.5 * h * (state.v + after)
    if physics.bristles:
        memory = physics.bristles_after(_memory(physics, state) if memory is None else memory, moved)
    return State(state.q + moved, after, memory)


def law_by_effort(physics: Physics, joints: Sequence[JointSamples]) -> Array:
    """(B, n) derivative of the joint laws by the efforts that act."""
    total = np.zeros((len(joints[0].q), len(joints)))
    for effect in physics.joint_forces:
        total[:, physics.tree.joint_index(effect.at)] += physics.joint_force(effect, joints).d_u
    return total


def _driven(
    physics: Physics, servo: ServoInput | None, q: Array, v: Array, effort: Array, duration: Array
) -> tuple[Array, Array]:
    """The efforts (B, n) with those of servos, and the slope (B, n) of these in v."""
    if servo is None:
        return effort, np.zeros_like(effort)
    return servo.drive(physics, q, v, effort, duration)


def advance(
    physics: Physics,
    state: State,
    effort: Array,
    duration: Array,
    servo: ServoInput | None = None,
    longest: float = LONGEST_STEP,
) -> State:
    """The state after `duration` (B,) s under a constant `effort` (B, n), in as many equal steps as the model needs.

    Where a `servo` drives a joint, its effort under a constant command is added. No step is longer than `longest`, s.
    """
    touching = physics.contacts or any(force.stiff for force in physics.body_forces)
    longest = min(LONGEST_CONTACT_STEP, longest) if touching else longest
    count = max(1, int(np.ceil(float(np.max(duration)) / longest - 1e-6)))
    quickly = _has_joint_laws_alone(physics)
    if quickly and not physics.joint_forces and servo is None:
        return _step_compiled(physics, state, effort, np.zeros_like(effort), duration / count, count)
    for _ in range(count):
        if quickly:
            state = _step_by_laws((physics,), state, effort, duration / count, servo)
        else:
            state = step(physics, state, effort, duration / count, servo)
    return state


def advance_each(
    each: Sequence[Physics], state: State, effort: Array, duration: Array, servo: ServoInput | None = None
) -> list[State]:
    """`advance` of each of several physics from the same `state`.

    Laws of joints that they share are evaluated for all of them at once where nothing else acts.
    """
    first = each[0]
    alike = servo is None and all(
        _has_joint_laws_alone(physics)
        and not physics.contacts
        and not physics.depends_on_load
        and physics.bristles == first.bristles
        and len(physics.joint_forces) == len(first.joint_forces) > 0
        for physics in each
    )
    if not alike:
        return [advance(physics, state, effort, duration, servo) for physics in each]
    count, copies = max(1, int(np.ceil(float(np.max(duration)) / LONGEST_STEP - 1e-6))), (len(each), 1)
    memory = None if state.memory is None else np.tile(state.memory, copies)
    state = State(np.tile(state.q, copies), np.tile(state.v, copies), memory)
    effort, duration = np.tile(effort, copies), np.tile(duration, len(each))
    for _ in range(count):
        state = _step_by_laws(each, state, effort, duration / count)
    own = np.split(np.arange(len(duration)), len(each))
    return [State(state.q[k], state.v[k], None if state.memory is None else state.memory[k]) for k in own]


def _has_joint_laws_alone(physics: Physics) -> bool:
    """Whether laws of joints are all that is added to the nominal model, beside contacts of compiled code."""
    return physics.spheres is not None and not physics.body_forces and not physics.tree.followers


def _step_by_laws(
    each: Sequence[Physics], state: State, effort: Array, duration: Array, servo: ServoInput | None = None
) -> State:
    """`step` by compiled code, for physics whose only additions to the nominal model are joint laws.

    The simulations are those of `each` physics, one after another, as many of each; a `servo` drives those of one.
    """
    first, q_middle = each[0], state.q + 0.5 * duration[:, None] * state.v
    effort, slope = _driven(first, servo, q_middle, state.v, effort, duration)
    joints = _joints(first, q_middle, state, effort, duration)
    law, by_servo = np.zeros_like(effort), slope.copy()
    for number, j in enumerate(_joints_with_laws(first)):
        found = _law(each, number, joints[j])
        law[:, j] += found.value
        slope[:, j] += found.d_v + found.d_u * by_servo[:, j]
    own = np.split(np.arange(len(duration)), len(each))

    def velocity_with(law: Array, slope: Array) -> Array:
        force = effort + law
        parts = [
            _step_compiled(physics, State(state.q[k], state.v[k]), force[k], slope[k], duration[k], 1).v
            for physics, k in zip(each, own, strict=True)
        ]
        return np.concatenate(parts)

    after = velocity_with(law, slope)
    turning = _Turning.of(each, joints, after)
    if turning is not None:
        after = turning.after(velocity_with, law, slope, np.zeros_like(first.dampings))
    return _moved(first, state, duration[:, None], after, state.memory)


def _joints_with_laws(physics: Physics) -> list[int]:
    """The joint of each joint law."""
    return [physics.tree.joint_index(effect.at) for effect in physics.joint_forces]


def _law(each: Sequence[Physics], number: int, joint: JointSamples) -> Force:
    """The joint law `number` of `each` physics on its own ones of the samples, which follow each other."""
    laws = [physics.joint_forces[number] for physics in each]
    if all(law is laws[0] for law in laws):
        return laws[0].force(joint)
    own = np.split(np.arange(len(joint.q)), len(each))
    return joined_forces([law.force(joint.at(k)) for law, k in zip(laws, own, strict=True)])


def _step_compiled(physics: Physics, state: State, force: Array, slope: Array, duration: Array, count: int) -> State:
    """`count` compiled steps of `duration` (B,) s under a constant `force` (B, n) with its `slope` (B, n) in v."""
    tree = physics.tree
    numbers = (*tree.lumps, physics.rotor_inertias, physics.dampings, physics.gravity)
    samples = (*numbers, *(physics.spheres or ()), state.q, state.v, force, slope, duration)
    q, v = integrate(*tree.frames, *(np.ascontiguousarray(values) for values in samples), count)
    return State(q, v, state.memory)


def acting_efforts(
    physics: Physics, time: Array, u: Array, ramped: Sequence[bool], served: Collection[int] = ()
) -> tuple[Array, Array]:
    """Knots (K,) s and the acting efforts (K, n) held from each knot to the next, from samples `u` (N, n) at `time`.

    The knots hold the steps of every joint's effort after its actuator effects. The efforts of `ramped` joints are
    linear between samples: each piece between knots then has their mean, and no piece is longer than a step of the
    simulation. Where a servo drives a joint, one of `served`, the actuator effects act on the sum in the simulation.
    """
    efforts = []
    for j, name in enumerate(physics.tree.joint_names):
        effort = Effort(time, u[:, j], ramped[j])
        for effect in physics.actuators:
            if effect.at == name and j not in served:
                effort = effect.drive(effort)
        efforts.append(effort)
    together = all(len(effort.times) == len(time) and np.array_equal(effort.times, time) for effort in efforts)
    if together and not any(ramped):
        return time, np.stack([effort.values for effort in efforts], axis=1)
    knots = np.unique(np.concatenate([time, *(effort.times for effort in efforts)]))
    knots = knots[(knots >= time[0]) & (knots <= time[-1])]
    if any(ramped):
        parts = max(1, int(np.ceil(float(np.median(np.diff(time))) / LONGEST_STEP - 1e-6)))
        within = [knots[:-1] + k / parts * np.diff(knots) for k in range(parts)]
        knots = np.unique(np.concatenate([*within, knots[-1:]]))
    columns = []
    for effort in efforts:
        if effort.ramped:
            columns.append(effort.means(knots))
            continue
        index = np.clip(np.searchsorted(effort.times, knots, side="right") - 1, 0, None)
        columns.append(effort.values[index])
    return knots, np.stack(columns, axis=1)
