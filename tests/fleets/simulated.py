"""Recordings of a fleet's robots, by MuJoCo: arms of a few kinds, one of which wears while another loses its motor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pandas as pd

from tests.concealed import excitation
from tests.concealed.mujoco_arm import ArmInverse, mjcf
from tests.concealed.robots import Array, Robot, random_arm

STEP, FINE = 0.004, 0.0005
"""s, between samples, and of the integration."""
NOISE_Q, NOISE_V = 2e-4, 2e-3
MASS_STD = 0.05
"""Of the last link's mass, relative: what the scenario calls unknown."""


@dataclass(frozen=True)
class Condition:
    """What a robot is like when it is recorded: damping (n,) N m s/rad beyond its model, gains (n,) of its motors."""

    damping: Array
    gain: Array


@dataclass(frozen=True)
class Kind:
    """A kind of robot, as its model file says."""

    name: str
    nominal: Robot


def kinds(rng: np.random.Generator, count: int) -> list[Kind]:
    """Kinds of two and three joints, by turns."""
    found = []
    for k in range(count):
        robot = random_arm(rng, 2 + k % 2)
        straight = [replace(joint, kind="revolute") for joint in robot.joints]
        found.append(
            Kind(f"kind_{'abcdefgh'[k]}", replace(robot, name=f"kind_{'abcdefgh'[k]}", joints=tuple(straight)))
        )
    return found


def individual(rng: np.random.Generator, kind: Kind) -> Robot:
    """A robot of the kind, whose last link weighs a little more or less."""
    robot = kind.nominal
    last = robot.links[-1]
    factor = 1.0 + MASS_STD * float(np.clip(rng.normal(), -2.0, 2.0))
    return robot.replace_link(robot.size - 1, last.with_mass(last.mass * factor))


def recorded(rng: np.random.Generator, kind: Kind, robot: Robot, condition: Condition, duration: float) -> pd.DataFrame:
    """One recording of the robot under feedforward and a soft PD controller."""
    n, samples = robot.size, round(duration / STEP)
    wanted = excitation.desired(rng, 1, samples, STEP, n, "rich", np.zeros(n, dtype=bool))
    inverse = ArmInverse(kind.nominal)
    feedforward = inverse.torque(wanted.q[0], wanted.v[0], wanted.a[0])
    inertia = np.diag(inverse.mass_matrix(wanted.q[0, 0])) + [joint.rotor_inertia for joint in kind.nominal.joints]
    worn = robot
    for joint in range(n):
        worn = worn.replace_joint(joint, damping=robot.joints[joint].damping + float(condition.damping[joint]))
    model = mujoco.MjModel.from_xml_string(mjcf(worn, 1))
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, FINE
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = wanted.q[0, 0], wanted.v[0, 0]
    q, v, u = (np.zeros((samples, n)) for _ in range(3))
    noise_q, noise_v = (std * rng.normal(size=(samples, n)) for std in (NOISE_Q, NOISE_V))
    for k in range(samples):
        q[k], v[k] = data.qpos, data.qvel
        error, rate = wanted.q[0, k] - q[k] - noise_q[k], wanted.v[0, k] - v[k] - noise_v[k]
        u[k] = feedforward[k] + inertia * (36.0 * error + 9.6 * rate)
        data.qfrc_applied[:] = condition.gain * u[k]
        for _ in range(round(STEP / FINE)):
            mujoco.mj_step(model, data)
    columns = {"time": STEP * np.arange(samples)}
    for name, values in (("q", q + noise_q), ("v", v + noise_v), ("u", u)):
        columns |= {f"{name}.{joint.name}": values[:, j] for j, joint in enumerate(robot.joints)}
    return pd.DataFrame(columns)


def scenario(kind: Kind) -> dict[str, object]:
    """The scenario as a user would write it."""
    last = kind.nominal.links[-1]
    return {
        "model": f"{kind.name}.urdf",
        "weld": [{"body": "base"}],
        "channels": {"q": {"std": NOISE_Q}, "v": {"std": NOISE_V}, "u": {"std": 0.0}},
        "unknown": [{"parameter": "mass", "body": last.name, "mean": last.mass, "std": MASS_STD * last.mass}],
    }
