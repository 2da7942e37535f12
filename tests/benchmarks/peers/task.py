"""A task of the bench: a robot in MuJoCo, its parameters with values to start from, and its recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from tests.concealed.excitation import multisine
from tests.concealed.mujoco_arm import mjcf as arm
from tests.concealed.robots import Array, Robot

STEP, SAMPLE = 1e-3, 5e-3
"""s, of the simulation and of the recording."""
EVERY = round(SAMPLE / STEP)
FRICTION_SOLREF = [2.0 * STEP, 1.0]
"""As stiff as the engine's steps allow. By its default of 20 ms dry friction changes its sign 10 ms before the velocity
does, which no joint's does."""
STD = {"q": 1e-3, "v": 1e-2, "u": 0.05}
"""Noise of one sample: rad, rad/s, N m."""


@dataclass(frozen=True)
class Parameter:
    """A parameter by its kind (mass of a link; damping, friction or armature of a joint), its place and values."""

    kind: str
    at: str
    true: float
    start: float

    @property
    def name(self) -> str:
        return f"{self.kind}.{self.at}"


@dataclass(frozen=True, eq=False)
class Task:
    """A robot that is driven by position servos, or by torques that are held from sample to sample."""

    name: str
    robot: Robot
    parameters: tuple[Parameter, ...]
    duration: float
    seeds: int
    servo: tuple[tuple[float, float], ...] | None
    """(kp, kv) of each joint; None where torques drive it."""
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    """Of the motion, rad, or of the torque, N m."""
    frequencies: tuple[float, float] = (0.2, 1.2)

    @property
    def true(self) -> Array:
        return np.array([parameter.true for parameter in self.parameters])

    @property
    def start(self) -> Array:
        return np.array([parameter.start for parameter in self.parameters])

    @property
    def names(self) -> list[str]:
        return [joint.name for joint in self.robot.joints]

    @cached_property
    def xml(self) -> str:
        """MJCF with the parameters at their starts."""
        return mjcf(self.robot, self.servo, self.parameters)

    def model(self, values: Sequence[float] | Array) -> mujoco.MjModel:
        """The compiled model at these values."""
        spec = mujoco.MjSpec.from_string(self.xml)
        for parameter, value in zip(self.parameters, values, strict=True):
            set_value(spec, parameter, float(value))
        return spec.compile()

    def controls(self, seed: int) -> Array:
        """Positions or torques that are commanded at each step of the simulation (S, n)."""
        rng = np.random.default_rng([len(self.name), seed])
        time = STEP * np.arange(round(self.duration / STEP))
        held = time if self.servo else SAMPLE * np.floor(time / SAMPLE + 1e-9)
        out = np.empty((len(time), self.robot.size))
        for j, (centre, reach) in enumerate(zip(self.centre, self.reach, strict=True)):
            parts = 4
            amplitude = reach * rng.dirichlet(np.ones(parts))
            frequency = rng.uniform(*self.frequencies, parts)
            wave = multisine(held, amplitude, frequency, rng.uniform(0.0, 2.0 * np.pi, parts))[0]
            # from rest: servos at their target, torques from none
            out[:, j] = centre + (wave - wave[0]) * np.minimum(held / 0.5, 1.0)
        return out


@dataclass(frozen=True)
class Recorded:
    """Samples: time (N,), q, v, u (N, n) with noise; `controls` (S, n) at every step; the state at the start."""

    time: Array
    q: Array
    v: Array
    u: Array
    controls: Array
    q0: Array
    v0: Array


def mjcf(robot: Robot, servo: Sequence[tuple[float, float]] | None, parameters: Sequence[Parameter]) -> str:
    """The arm with sensors and actuators; no contact, no limits."""
    for parameter in parameters:
        if parameter.kind == "mass":
            link = robot.link_index(parameter.at)
            robot = robot.replace_link(link, robot.links[link].with_mass(parameter.start))
    body = arm(robot, 1).replace("_0", "")
    names = [joint.name for joint in robot.joints]
    actuators = "".join(
        f'<motor name="{name}" joint="{name}"/>'
        if servo is None
        else f'<position name="{name}" joint="{name}" kp="{servo[j][0]}" kv="{servo[j][1]}"/>'
        for j, name in enumerate(names)
    )
    sensors = "".join(
        f'<{kind} name="{short}_{name}" joint="{name}"/>'
        for kind, short in (("jointpos", "q"), ("jointvel", "v"), ("jointactuatorfrc", "u"))
        for name in names
        if servo is not None or short != "u"
    )
    option = f'<option timestep="{STEP}" integrator="RK4"><flag contact="disable"/></option>'
    start, stop = body.index("<option"), body.index("</option>") + len("</option>")
    whole = body[:start] + option + body[stop:]
    whole = whole.replace("</mujoco>", f"<actuator>{actuators}</actuator><sensor>{sensors}</sensor></mujoco>")
    spec = mujoco.MjSpec.from_string(whole)
    spec.option.gravity = robot.gravity
    for joint in spec.joints:
        joint.solref_friction = FRICTION_SOLREF
    for parameter in parameters:
        if parameter.kind != "mass":
            set_value(spec, parameter, parameter.start)
    spec.compile()
    return str(spec.to_xml())


def set_value(spec: mujoco.MjSpec, parameter: Parameter, value: float) -> None:
    """Writes a parameter; a mass scales its inertia."""
    if parameter.kind == "mass":
        body = spec.body(parameter.at)
        body.inertia = np.array(body.inertia) * (value / body.mass)
        body.mass = value
        return
    joint = spec.joint(parameter.at)
    if parameter.kind == "damping":
        joint.damping = [value, 0.0, 0.0]
    elif parameter.kind == "friction":
        joint.frictionloss = value
    else:
        joint.armature = value


def simulated(
    task: Task, values: Sequence[float] | Array, controls: Array, q0: Array, v0: Array
) -> tuple[Array, Array, Array]:
    """q, v, u at the samples (N, n), noise-free: what sensors show before the sample's step."""
    model = task.model(values)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q0, v0
    n, N = task.robot.size, len(controls) // EVERY
    q, v, u = np.empty((N, n)), np.empty((N, n)), np.empty((N, n))
    for k, control in enumerate(controls[: N * EVERY]):
        data.ctrl[:] = control
        if k % EVERY == 0:
            q[k // EVERY], v[k // EVERY] = data.qpos, data.qvel
        mujoco.mj_step(model, data)
        if k % EVERY == 0:
            # sensors show the state before the step; what else is left of it belongs to a stage within
            u[k // EVERY] = data.sensordata[2 * n :] if task.servo else control
    return q, v, u


def record(task: Task, seed: int) -> Recorded:
    """The task's recording of a seed: its own motion and its own noise."""
    controls = task.controls(seed)
    q0, v0 = np.array(task.centre if task.servo else np.zeros(task.robot.size)), np.zeros(task.robot.size)
    q, v, u = simulated(task, task.true, controls, q0, v0)
    rng = np.random.default_rng([seed, 1])
    noisy_u = u + STD["u"] * rng.normal(size=u.shape) if task.servo else u
    return Recorded(
        SAMPLE * np.arange(len(q)),
        q + STD["q"] * rng.normal(size=q.shape),
        v + STD["v"] * rng.normal(size=v.shape),
        noisy_u,
        controls,
        q0,
        v0,
    )


def bound(task: Task, seed: int) -> Array:
    """(p,) Cramér–Rao standard deviations: whole rollouts in MuJoCo, servo gains known, initial state free.

    Central differences of what the recording holds: q, v, and, under servos, the torque.
    """
    controls = task.controls(seed)
    start = np.array(task.centre if task.servo else np.zeros(task.robot.size)), np.zeros(task.robot.size)
    n = task.robot.size

    def outputs(values: Array, state: Array) -> Array:
        q, v, u = simulated(task, values, controls, state[:n], state[n:])
        parts = [q / STD["q"], v / STD["v"], *([u / STD["u"]] if task.servo else [])]
        return np.concatenate(parts, axis=1).ravel()

    state, columns = np.concatenate(start), []
    for i, value in enumerate(task.true):
        step = 1e-4 * abs(value) * np.eye(len(task.true))[i]
        columns.append((outputs(task.true + step, state) - outputs(task.true - step, state)) / (2e-4 * abs(value)))
    for push in 1e-6 * np.eye(2 * n):
        columns.append((outputs(task.true, state + push) - outputs(task.true, state - push)) / 2e-6)
    J = np.stack(columns, axis=1)
    size = np.linalg.norm(J, axis=0)
    # an unstable motion's columns differ by many powers of ten
    triangle = np.linalg.qr(np.roll(J / size, 2 * n, axis=1), mode="r")[2 * n :, 2 * n :]
    inverse = np.linalg.inv(triangle)
    return np.asarray(np.linalg.norm(inverse, axis=1) / size[: len(task.true)])
