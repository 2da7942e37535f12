"""Simulation of planned motions: a robot with given physics, under a controller based on the nominal model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.noise.coloured import drawn, stated_memories
from drake_cafim.diagnosis.predict.servo_input import ServoInput
from drake_cafim.diagnosis.predict.stepper import pushed
from drake_cafim.discrimination.motions import MARGIN, Limits, Motion
from drake_cafim.discrimination.planned import driving_columns
from drake_cafim.discrimination.servo_commands import ServoPlan
from drake_cafim.dynamics.motion import equations_of_motion, mass_matrix, motion
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

BANDWIDTH = 2.0 * np.pi * 3.0
"""rad/s of the controller, critically damped."""
LONGEST_STEP, LONGEST_CONTACT_STEP, LONGEST_COUPLED_STEP = 2e-3, 5e-4, 5e-4
"""s, longest integration steps: in general, with contacts, and with couplings, of which the last two are stiff."""
PAST = 0.4
"""s of past efforts that are given to the actuator effects: twice the longest delay in their bounds."""
ROTOR_SHARE = 1e-9
"""kg m² (kg) left where a rotor is taken off its link, so that a link without inertia stays solvable."""


@dataclass(frozen=True)
class _State:
    """State of B parallel runs: positions and velocities (B, n), of the rotors (B, c), contacts' memory (B, m)."""

    q: Array
    v: Array
    theta: Array
    omega: Array
    memory: Array | None


def simulated(physics: Physics, nominal: Physics, limits: Limits, planned: Motion) -> Motion:
    """The simulated motion of a robot with `physics` that follows `planned`; `u` (T, n) are the commanded efforts.

    u = planned u + M(q) (ω² (q_planned − q) + 2 ω (v_planned − v)) with the `nominal` M, within the model's limits.
    The controller reads the links' true positions and velocities.
    """
    return simulated_together(physics, nominal, limits, [planned])[0]


def simulated_together(
    physics: Physics, nominal: Physics, limits: Limits, planned: Sequence[Motion]
) -> tuple[Motion, ...]:
    """`simulated` for several motions on the same time grid, as independent runs of one vectorised simulation."""
    most = limits.effort / MARGIN
    time = planned[0].time
    wanted_q, wanted_v, wanted_u = (np.stack([getattr(path, name) for path in planned], axis=1) for name in "qvu")
    q, v, u = np.empty_like(wanted_q), np.empty_like(wanted_v), np.empty_like(wanted_u)  # (T, B, n)
    state = _start(physics, planned)
    plan = None
    if nominal.servos:
        plan = ServoPlan.of(physics, time, np.stack([_sent(path) for path in planned], axis=1))
    for k in range(len(time)):
        q[k], v[k] = state.q, state.v
        moving = motion(nominal.tree, state.q, state.v)
        M = mass_matrix(moving) + np.diag(nominal.rotor_inertias)
        error = BANDWIDTH**2 * (wanted_q[k] - state.q) + 2.0 * BANDWIDTH * (wanted_v[k] - state.v)
        u[k] = np.clip(wanted_u[k] + (M @ error[..., None])[..., 0], -most, most)
        servo = None
        if plan is not None:
            servo = plan.input(physics, k)
            u[k] = np.where(servo.on > 0.0, 0.0, u[k])
        if k + 1 < len(time):
            first = max(int(np.searchsorted(time, time[k] - PAST)), 0)
            for edge, until, effort in _acting(physics, time[first : k + 2], u[first : k + 1]):
                state = _advanced(physics, state, effort, until - edge, servo)
    return tuple(Motion(time, q[:, b], v[:, b], u[:, b], path.cmd) for b, path in enumerate(planned))


def _sent(path: Motion) -> Array:
    """The commands (T, n) of a planned motion, NaN where it has none."""
    return path.cmd if path.cmd is not None else np.full_like(path.q, np.nan)


def measured(
    scene: Scene, physics: Physics, run: Motion, std: Mapping[str, float], random: np.random.Generator, name: str
) -> Recording:
    """The recording of a run by the sensors of `physics`, effects included, with noise of `std` by channel."""
    names = scene.tree.joint_names
    columns = {f"q.{joint}": run.q[:, j] for j, joint in enumerate(names)}
    if f"v.{names[0]}" in std:
        columns |= {f"v.{joint}": run.v[:, j] for j, joint in enumerate(names)}
    columns |= driving_columns(scene, run)
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
    """The recording with Gaussian noise of `std` added by channel, coloured where the scenario states a memory."""
    memories, columns = stated_memories(scene, list(std)), dict(clean.columns)
    for column, spread in std.items():
        if spread > 0.0:
            columns[column] = columns[column] + spread * drawn(random, clean.time, memories.get(column))
    return Recording(clean.name, clean.time, columns)


def _start(physics: Physics, planned: Sequence[Motion]) -> _State:
    """The initial state: each motion's first sample, the rotors at rest in static equilibrium with the first effort."""
    q, v, u = (np.stack([getattr(path, name)[0] for path in planned]) for name in "qvu")
    theta = []
    for coupling in physics.couplings:
        j = physics.tree.joint_index(coupling.at)
        theta.append(q[:, j] + np.array([coupling.balance(float(effort)) for effort in u[:, j]]))
    memory = [
        physics.contact_memory(path.time[:1], *(2 * [motion(physics.tree, path.q[:1], path.v[:1])]))[0]
        for path in planned
    ]
    rotors = np.array(theta).reshape(-1, len(planned)).T
    return _State(q, v, rotors, np.zeros_like(rotors), np.stack(memory))


def _acting(physics: Physics, time: Array, u: Array) -> list[tuple[float, float, Array]]:
    """Pieces (start s, end s, acting effort (B, n)) of the interval between the last two of `time` (K + 1,) s.

    `u` (K, B, n) are the commanded efforts at `time` but the last.
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
    """The acting effort for commands `u` (K,); `time` includes the end of the last hold, as a lag subdivides holds."""
    effort = Effort(time, np.append(u, u[-1]))
    for effect in physics.actuators:
        if effect.at == joint:
            effort = effect.drive(effort)
    return effort


def _held(effort: Effort, at: float) -> float:
    return float(effort.values[max(int(np.searchsorted(effort.times, at, side="right")) - 1, 0)])


def _advanced(
    physics: Physics, state: _State, effort: Array, duration: float, servo: ServoInput | None = None
) -> _State:
    longest = LONGEST_CONTACT_STEP if physics.contacts else LONGEST_STEP
    longest = min(longest, LONGEST_COUPLED_STEP) if physics.couplings else longest
    count = max(1, int(np.ceil(duration / longest - 1e-6)))
    for _ in range(count):
        state = _step(physics, state, effort, duration / count, servo)
    return state


def _step(physics: Physics, state: _State, effort: Array, h: float, servo: ServoInput | None = None) -> _State:
    """The linearly implicit midpoint rule, as in the diagnosis, for links and rotors together.

    A coupled joint's rotor is an additional degree of freedom, driven by the effort (B, n) and tied to the link by the
    coupling's torque; the derivatives of that torque enter implicitly.
    """
    (count, n), c = state.q.shape, len(physics.couplings)
    q = state.q + 0.5 * h * state.v
    theta = state.theta + 0.5 * h * state.omega
    rigid = mass_matrix(motion(physics.tree, q, state.v))
    by_servo = np.zeros_like(effort)
    if servo is not None:
        effort, by_servo = servo.drive(physics, q, state.v, effort, np.full(count, h))
    load = physics.loads(q) if physics.depends_on_load else np.zeros_like(q)
    joints = [JointSamples(q[:, j], state.v[:, j], effort[:, j], load=load[:, j]) for j in range(n)]
    law, _, slope = physics.applied_at_joints(joints)
    slope = slope + by_servo
    force = np.zeros((count, n + c))
    force[:, :n] = effort + law
    M = np.zeros((count, n + c, n + c))
    M[:, :n, :n] = rigid + np.diag(physics.rotor_inertias)
    implicit = np.zeros_like(M)
    implicit[:, np.arange(n), np.arange(n)] = 0.5 * h * slope
    for i, coupling in enumerate(physics.couplings):
        j, rotor = physics.tree.joint_index(coupling.at), n + i
        inertia = physics.rotor_inertias[j]
        M[:, j, j] += ROTOR_SHARE - inertia
        M[:, rotor, rotor] = inertia
        torque, stiffness, damping = coupling.slopes(theta[:, i] - q[:, j], state.omega[:, i] - state.v[:, j])
        force[:, j] += torque - effort[:, j]
        force[:, rotor] = effort[:, j] - torque
        tie = 0.5 * h * damping + 0.25 * h * h * stiffness
        for row, column, sign in ((j, j, -1.0), (j, rotor, 1.0), (rotor, j, 1.0), (rotor, rotor, -1.0)):
            implicit[:, row, column] += sign * tie
    change = np.zeros((count, n + c))
    for _ in range(2):
        # what depends on all velocities is taken at the middle of the step, as far as the first pass tells it
        moving = motion(physics.tree, q, state.v + 0.5 * change[:, :n])
        push, memory = pushed(physics, moving, state.memory, np.full(count, h))
        total = force.copy()
        total[:, :n] += push - equations_of_motion(moving, physics.gravity)[1]
        change = np.linalg.solve(M - implicit, h * total[..., None])[..., 0]
    v, omega = change[:, :n], change[:, n:]
    return _State(
        state.q + h * (state.v + 0.5 * v),
        state.v + v,
        state.theta + h * (state.omega + 0.5 * omega),
        state.omega + omega,
        memory,
    )
