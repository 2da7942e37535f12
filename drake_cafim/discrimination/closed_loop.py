"""A planned motion run in simulation: the robot as a model has it, under a controller that knows the nominal model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.coloured_noise import drawn, stated_memories
from drake_cafim.discrimination.motions import MARGIN, Limits, Motion
from drake_cafim.dynamics.motion import equations_of_motion, mass_matrix, motion
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
    """Positions and velocities (B, n), rotors' (B, c), and what contacts remember (B, m), in B runs side by side."""

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
    return simulated_together(physics, nominal, limits, [planned])[0]


def simulated_together(
    physics: Physics, nominal: Physics, limits: Limits, planned: Sequence[Motion]
) -> tuple[Motion, ...]:
    """`simulated` of motions at the same times, each by itself but all in the time that one takes."""
    most = limits.effort / MARGIN
    time = planned[0].time
    wanted_q, wanted_v, wanted_u = (np.stack([getattr(one, name) for one in planned], axis=1) for name in "qvu")
    q, v, u = np.empty_like(wanted_q), np.empty_like(wanted_v), np.empty_like(wanted_u)  # (T, B, n)
    state = _start(physics, planned)
    for k in range(len(time)):
        q[k], v[k] = state.q, state.v
        moving = motion(nominal.tree, state.q, state.v)
        M = mass_matrix(moving) + np.diag(nominal.rotor_inertias)
        error = BANDWIDTH**2 * (wanted_q[k] - state.q) + 2.0 * BANDWIDTH * (wanted_v[k] - state.v)
        u[k] = np.clip(wanted_u[k] + (M @ error[..., None])[..., 0], -most, most)
        if k + 1 < len(time):
            first = max(int(np.searchsorted(time, time[k] - PAST)), 0)
            for edge, until, effort in _acting(physics, time[first : k + 2], u[first : k + 1]):
                state = _advanced(physics, state, effort, until - edge)
    return tuple(Motion(time, q[:, b], v[:, b], u[:, b]) for b in range(len(planned)))


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
    return noisy(scene, Recording(name, run.time, columns), std, random)


def noisy(scene: Scene, clean: Recording, std: Mapping[str, float], random: np.random.Generator) -> Recording:
    """The recording with noise of `std` on its channels, coloured where the scenario says so."""
    memories, columns = stated_memories(scene, list(std)), dict(clean.columns)
    for column, spread in std.items():
        if spread > 0.0:
            columns[column] = columns[column] + spread * drawn(random, clean.time, memories.get(column))
    return Recording(clean.name, clean.time, columns)


def _start(physics: Physics, planned: Sequence[Motion]) -> _State:
    """At rest at each motion's start, each rotor twisted as far as the first effort asks for."""
    q, v, u = (np.stack([getattr(one, name)[0] for one in planned]) for name in "qvu")
    theta = []
    for coupling in physics.couplings:
        j = physics.tree.joint_index(coupling.at)
        gap = 0.5 * coupling.values["gap"] * np.sign(u[:, j]) if isinstance(coupling, JointBacklash) else 0.0
        theta.append(q[:, j] + gap + u[:, j] / coupling.values["stiffness"])
    memory = [
        physics.contact_memory(one.time[:1], *(2 * [motion(physics.tree, one.q[:1], one.v[:1])]))[0] for one in planned
    ]
    rotors = np.array(theta).reshape(-1, len(planned)).T
    return _State(q, v, rotors, np.zeros_like(rotors), np.stack(memory))


def _acting(physics: Physics, time: Array, u: Array) -> list[tuple[float, float, Array]]:
    """The efforts (B, n) that act from the last but one of `time` (K + 1,) s to the last, each from when until when.

    `u` (K, B, n) was asked for.
    """
    start, stop = float(time[-2]), float(time[-1])
    drives = [[_drive(physics, time, u[:, b, j], name) for j, name in enumerate(physics.tree.joint_names)]
              for b in range(u.shape[1])]  # fmt: skip
    changes = [d.times[(d.times > start) & (d.times < stop)] for joints in drives for d in joints]
    edges = np.unique(np.concatenate([[start, stop], *changes]))
    found = []
    for edge, until in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        held = [[_held(d, edge) for d in joints] for joints in drives]
        found.append((edge, until, np.array(held)))
    return found


def _drive(physics: Physics, time: Array, u: Array, joint: str) -> Effort:
    """What the joint's actuator makes of `u` (K,); the last hold must have its length, since a lag divides holds."""
    effort = Effort(time, np.append(u, u[-1]))
    for effect in physics.actuators:
        if effect.at == joint:
            effort = effect.drive(effort)
    return effort


def _held(effort: Effort, at: float) -> float:
    return float(effort.values[max(int(np.searchsorted(effort.times, at, side="right")) - 1, 0)])


def _advanced(physics: Physics, state: _State, effort: Array, duration: float) -> _State:
    longest = LONGEST_CONTACT_STEP if physics.contacts else LONGEST_STEP
    longest = min(longest, LONGEST_COUPLED_STEP) if physics.couplings else longest
    count = max(1, int(np.ceil(duration / longest - 1e-6)))
    for _ in range(count):
        state = _step(physics, state, effort, duration / count)
    return state


def _step(physics: Physics, state: _State, effort: Array, h: float) -> _State:
    """The linearly implicit midpoint rule, as in the diagnosis, for links and rotors together.

    A coupled joint's rotor is a degree of freedom of its own, which the effort (B, n) drives and the coupling's torque
    ties to the link; the slopes of that torque are taken implicitly.
    """
    (count, n), c = state.q.shape, len(physics.couplings)
    q = state.q + 0.5 * h * state.v
    theta = state.theta + 0.5 * h * state.omega
    moving = motion(physics.tree, q, state.v)
    rigid, bias = equations_of_motion(moving, physics.gravity)
    joints = [JointSamples(q[:, j], state.v[:, j], effort[:, j]) for j in range(n)]
    law, _, slope = physics.applied_at_joints(joints)
    force = np.zeros((count, n + c))
    force[:, :n] = effort + law - bias
    memory = state.memory
    if physics.contacts:
        own = None
        if memory.shape[1]:
            elapsed, left = np.full(count, 0.5 * h), np.zeros(count)
            own = physics.remembered(memory, moving, elapsed, left)
            memory = physics.remembered(memory, moving, 2.0 * elapsed, elapsed)
        force[:, :n] += moving.project(physics.contact_wrenches(moving, own))
    if physics.body_forces:
        force[:, :n] += moving.project(physics.body_wrenches(moving))
    M = np.zeros((count, n + c, n + c))
    M[:, :n, :n] = rigid + np.diag(physics.rotor_inertias)
    implicit = np.zeros_like(M)
    implicit[:, np.arange(n), np.arange(n)] = 0.5 * h * slope
    for i, coupling in enumerate(physics.couplings):
        j, rotor = physics.tree.joint_index(coupling.at), n + i
        inertia = physics.rotor_inertias[j]
        M[:, j, j] += ROTOR_SHARE - inertia
        M[:, rotor, rotor] = inertia
        torque, stiffness, damping = _torque(coupling, theta[:, i] - q[:, j], state.omega[:, i] - state.v[:, j])
        force[:, j] += torque - effort[:, j]
        force[:, rotor] = effort[:, j] - torque
        tie = 0.5 * h * damping + 0.25 * h * h * stiffness
        for row, column, sign in ((j, j, -1.0), (j, rotor, 1.0), (rotor, j, 1.0), (rotor, rotor, -1.0)):
            implicit[:, row, column] += sign * tie
    change = np.linalg.solve(M - implicit, h * force[..., None])[..., 0]
    v, omega = change[:, :n], change[:, n:]
    return _State(
        state.q + h * (state.v + 0.5 * v),
        state.v + v,
        state.theta + h * (state.omega + 0.5 * omega),
        state.omega + omega,
        memory,
    )


def _torque(coupling: JointCoupling, twist: Array, rate: Array) -> tuple[Array, Array, Array]:
    """What the coupling exerts on its link (B,), and its slopes in the twist and in its rate."""
    stiffness, damping = coupling.values["stiffness"], coupling.values["damping"]
    half = 0.5 * coupling.values["gap"] if isinstance(coupling, JointBacklash) else 0.0
    beyond = twist - np.clip(twist, -half, half)
    torque = stiffness * beyond + damping * rate
    # teeth push and do not pull
    meshed = np.asarray((half == 0.0) | (torque * beyond > 0.0), dtype=float)
    return meshed * torque, meshed * stiffness, meshed * damping
