"""A planned motion run in simulation: the robot as a model has it, under a controller that knows the nominal model."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.coloured_noise import drawn, stated_memories
from drake_cafim.discrimination.motions import MARGIN, Limits, Motion
from drake_cafim.dynamics.motion import bias_force, mass_matrix, motion
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.coupling import JointBacklash, JointCoupling
from drake_cafim.effects.effect import JointSamples
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

BANDWIDTH = 2.0 * np.pi * 3.0
"""rad/s of the controller, critically damped."""
LONGEST_STEP, LONGEST_CONTACT_STEP, LONGEST_COUPLED_STEP = 2e-3, 5e-4, 5e-4
"""s; contacts and rotors on springs are stiff."""
PAST = 0.4
"""s of efforts that a drive can still know of: twice the longest delay."""
ROTOR_SHARE = 1e-9
"""kg m² (kg) left where a rotor is taken off its link, so that a link without inertia stays solvable."""


@dataclass(frozen=True)
class _State:
    """Positions and velocities (n,), rotors' (c,), and what contacts remember (m,)."""

    q: Array
    v: Array
    theta: Array
    omega: Array
    memory: Array


def simulated(physics: Physics, nominal: Physics, limits: Limits, planned: Motion) -> Motion:
    """What happens when the robot is `physics` and follows `planned`; its efforts `u` (T, n) are as asked for.

    u = planned u + M(q) (ω² (q_planned − q) + 2 ω (v_planned − v)) with the `nominal` M, within the model's limits.
    The controller sees the link without noise.
    """
    most = limits.effort / MARGIN
    count, n = planned.q.shape
    q, v, u = np.empty((count, n)), np.empty((count, n)), np.empty((count, n))
    state = _start(physics, planned)
    for k in range(count):
        q[k], v[k] = state.q, state.v
        moving = motion(nominal.tree, state.q[None], state.v[None])
        M = mass_matrix(moving, moving.link_inertias)[0] + np.diag(nominal.rotor_inertias)
        error = BANDWIDTH**2 * (planned.q[k] - state.q) + 2.0 * BANDWIDTH * (planned.v[k] - state.v)
        u[k] = np.clip(planned.u[k] + M @ error, -most, most)
        if k + 1 < count:
            first = max(int(np.searchsorted(planned.time, planned.time[k] - PAST)), 0)
            acting = _acting(physics, planned.time[first : k + 2], u[first : k + 1])
            for edge, until, effort in acting:
                state = _advanced(physics, state, effort, until - edge)
    return Motion(planned.time, q, v, u)


def measured(
    scene: Scene, physics: Physics, run: Motion, std: Mapping[str, float], random: np.random.Generator, name: str
) -> Recording:
    """The recording of a run: what the sensors of `physics` write of it, with the noise of `std`."""
    names = scene.tree.joint_names
    columns = {f"q.{joint}": run.q[:, j] for j, joint in enumerate(names)}
    if f"v.{names[0]}" in std:
        columns |= {f"v.{joint}": run.v[:, j] for j, joint in enumerate(names)}
    columns |= {f"u.{joint}": run.u[:, j] for j, joint in enumerate(names)}
    if scene.wrench_sensors:
        moving = motion(physics.tree, run.q, run.v)
        wrench = physics.contact_wrenches(moving, physics.contact_memory(run.time, moving, moving))
        for sensor in scene.wrench_sensors:
            reading = sensor.reading(moving, wrench[:, sensor.joint])
            columns |= {f"wrench.{sensor.name}.{axis}": reading[:, k] for k, axis in enumerate(WRENCH_COMPONENTS)}
    for effect in physics.sensors:
        on = effect.channels(tuple(columns))
        written = effect.measured(run.time, np.stack([columns[name] for name in on], axis=1))
        columns |= {name: written[:, k] for k, name in enumerate(on)}
    memories = stated_memories(scene, list(std))
    for column, spread in std.items():
        if spread > 0.0:
            noise = spread * drawn(random, run.time, memories.get(column))
            columns[column] = columns[column] + noise
    return Recording(name, run.time, columns)


def _start(physics: Physics, planned: Motion) -> _State:
    """At rest at the motion's start, each rotor twisted as far as the first effort asks for."""
    q, v = planned.q[0].copy(), planned.v[0].copy()
    theta = []
    for coupling in physics.couplings:
        j = physics.tree.joint_index(coupling.at)
        push = float(planned.u[0, j])
        gap = 0.5 * coupling.values["gap"] * float(np.sign(push)) if isinstance(coupling, JointBacklash) else 0.0
        theta.append(q[j] + gap + push / coupling.values["stiffness"])
    memory = physics.contact_memory(planned.time[:1], *(2 * [motion(physics.tree, q[None], v[None])]))[0]
    return _State(q, v, np.array(theta), np.zeros(len(theta)), memory)


def _acting(physics: Physics, time: Array, u: Array) -> list[tuple[float, float, Array]]:
    """The efforts (n,) that act from the last but one of `time` (K + 1,) s to the last, each from when until when."""
    start, stop = float(time[-2]), float(time[-1])
    drives = []
    for j, name in enumerate(physics.tree.joint_names):
        effort = Effort(time, np.append(u[:, j], u[-1, j]))  # a lag divides holds: the last one must have its length
        for effect in physics.actuators:
            if effect.at == name:
                effort = effect.drive(effort)
        drives.append(effort)
    edges = np.unique(np.concatenate([[start, stop], *(d.times[(d.times > start) & (d.times < stop)] for d in drives)]))
    found = []
    for edge, until in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        held = [d.values[max(int(np.searchsorted(d.times, edge, side="right")) - 1, 0)] for d in drives]
        found.append((edge, until, np.array(held)))
    return found


def _advanced(physics: Physics, state: _State, effort: Array, duration: float) -> _State:
    longest = LONGEST_CONTACT_STEP if physics.contacts else LONGEST_STEP
    longest = min(longest, LONGEST_COUPLED_STEP) if physics.couplings else longest
    count = max(1, int(np.ceil(duration / longest - 1e-6)))
    for _ in range(count):
        state = _step(physics, state, effort, duration / count)
    return state


def _step(physics: Physics, state: _State, effort: Array, h: float) -> _State:
    """The linearly implicit midpoint rule, as in the diagnosis, for links and rotors together.

    A coupled joint's rotor is a degree of freedom of its own, which the effort drives and the coupling's torque ties to
    the link; the slopes of that torque are taken implicitly.
    """
    n, c = len(state.q), len(physics.couplings)
    q = state.q + 0.5 * h * state.v
    theta = state.theta + 0.5 * h * state.omega
    moving = motion(physics.tree, q[None], state.v[None])
    inertias = moving.link_inertias
    joints = [JointSamples(q[j : j + 1], state.v[j : j + 1], effort[j : j + 1]) for j in range(n)]
    law, _, slope = physics.applied_at_joints(joints)
    force = np.zeros(n + c)
    force[:n] = effort + law[0] - bias_force(moving, inertias, physics.gravity)[0]
    memory = state.memory
    if physics.contacts:
        own = None
        if len(memory):
            elapsed, left = np.full(1, 0.5 * h), np.zeros(1)
            own = physics.remembered(memory[None], moving, elapsed, left)
            memory = physics.remembered(memory[None], moving, 2.0 * elapsed, elapsed)[0]
        force[:n] += moving.project(physics.contact_wrenches(moving, own))[0]
    if physics.body_forces:
        force[:n] += moving.project(physics.body_wrenches(moving))[0]
    M = np.zeros((n + c, n + c))
    M[:n, :n] = mass_matrix(moving, inertias)[0] + np.diag(physics.rotor_inertias)
    implicit = np.zeros_like(M)
    implicit[np.arange(n), np.arange(n)] = 0.5 * h * slope[0]
    for i, coupling in enumerate(physics.couplings):
        j, rotor = physics.tree.joint_index(coupling.at), n + i
        inertia = physics.rotor_inertias[j]
        M[j, j] += ROTOR_SHARE - inertia
        M[rotor, rotor] = inertia
        torque, stiffness, damping = _torque(coupling, theta[i] - q[j], state.omega[i] - state.v[j])
        force[j] += torque - effort[j]
        force[rotor] = effort[j] - torque
        tie = 0.5 * h * damping + 0.25 * h * h * stiffness
        for row, column, sign in ((j, j, -1.0), (j, rotor, 1.0), (rotor, j, 1.0), (rotor, rotor, -1.0)):
            implicit[row, column] += sign * tie
    change = np.linalg.solve(M - implicit, h * force)
    v, omega = change[:n], change[n:]
    return _State(
        state.q + h * (state.v + 0.5 * v),
        state.v + v,
        state.theta + h * (state.omega + 0.5 * omega),
        state.omega + omega,
        memory,
    )


def _torque(coupling: JointCoupling, twist: float, rate: float) -> tuple[float, float, float]:
    """What the coupling exerts on its link, and its slopes in the twist and in its rate."""
    stiffness, damping = coupling.values["stiffness"], coupling.values["damping"]
    half = 0.5 * coupling.values["gap"] if isinstance(coupling, JointBacklash) else 0.0
    beyond = twist - float(np.clip(twist, -half, half))
    torque = stiffness * beyond + damping * rate
    if half > 0.0 and not torque * beyond > 0.0:
        return 0.0, 0.0, 0.0
    return torque, stiffness, damping
