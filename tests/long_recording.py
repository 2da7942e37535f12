"""Writes long recordings of a random arm that MuJoCo simulates, block by block: what an hour of a robot's log is like.

The arm moves little at first and more later. Viscous friction that its model lacks acts in one joint throughout; a
payload is taken up by the last link at a time of one's choice.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import yaml

from drake_cafim.recordings.parquet import write_blocks
from drake_cafim.typing import Array
from tests.concealed.mujoco_arm import ArmInverse, mjcf
from tests.concealed.robots import Robot, random_arm
from tests.concealed.urdf import arm_urdf

SUBSTEPS = 2
"""Steps of the simulation, Runge-Kutta of fourth order, in a sample."""
BLOCK = 20_000
"""Samples that are written at once."""
Q_STD, V_STD = 2e-4, 2e-3
"""rad, rad/s: noise of a sample."""
PLACE = np.array([0.1, 0.04, -0.03])
"""m, in the last link's axes: where a payload hangs; on the last joint's axis it might as well be at the one before."""


@dataclass(frozen=True)
class Long:
    """An arm of so many `joints`, `seconds` at `rate` Hz; viscous `friction`, N m s/rad, of its joint `at`.

    A `payload` of so many kg hangs at `PLACE` of the last link from `taken` s on.
    """

    joints: int
    seconds: float
    rate: float = 1000.0
    at: int = 1
    friction: float = 0.3
    payload: float = 0.0
    taken: float = 0.0
    seed: int = 1


def write(long: Long, folder: Path) -> Path:
    """Writes model, scenario and `log.parquet` into `folder`; returns the scenario's path."""
    rng = np.random.default_rng(long.seed)
    robot = random_arm(rng, long.joints, False)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.urdf").write_text(arm_urdf(robot))
    link = robot.links[1]
    scenario = {
        "model": "arm.urdf",
        "gravity": [0, 0, -9.81],
        "weld": [{"body": "base"}],
        "channels": {"q": {"std": Q_STD}, "v": {"std": V_STD}, "u": {"std": 0.0, "hold": "zero_order"}},
        "unknown": [{"parameter": "mass", "body": link.name, "mean": 1.05 * link.mass, "std": 0.1 * link.mass}],
    }
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario, sort_keys=False))
    write_blocks(_blocks(long, robot, rng), folder / "log.parquet")
    return folder / "scenario.yaml"


def _blocks(long: Long, robot: Robot, rng: np.random.Generator) -> Iterator[dict[str, Array]]:
    last = robot.links[-1].with_point_mass(long.payload, PLACE)
    model, loaded = _model(robot, long), _model(robot.replace_link(robot.size - 1, last), long)
    data, n = mujoco.MjData(model), robot.size
    desired = _Desired.of(rng, n, long.seconds)
    inverse = ArmInverse(robot)
    inertia = np.diag(inverse.mass_matrix(np.zeros(n)))
    stiffness, damping = 25.0 * inertia, 8.0 * inertia
    data.qpos[:], data.qvel[:] = desired.at(np.zeros(1))[0][0], 0.0
    count, taken = round(long.seconds * long.rate), round(long.taken * long.rate)
    for first in range(0, count, BLOCK):
        time = np.arange(first, min(first + BLOCK, count)) / long.rate
        q_d, v_d, a_d = desired.at(time)
        forward = inverse.torque(q_d, v_d, a_d)
        q, v, u = np.empty_like(q_d), np.empty_like(q_d), np.empty_like(q_d)
        for k in range(len(time)):
            if long.payload and first + k == taken:
                model = loaded
            q[k], v[k] = data.qpos, data.qvel
            u[k] = forward[k] + stiffness * (q_d[k] - q[k]) + damping * (v_d[k] - v[k])
            data.qfrc_applied[:] = u[k]
            for _ in range(SUBSTEPS):
                mujoco.mj_step(model, data)
        q = q + Q_STD * rng.standard_normal(q.shape)
        v = v + V_STD * rng.standard_normal(v.shape)
        yield {"time": time} | {
            f"{kind}.{joint.name}": values[:, j]
            for kind, values in (("q", q), ("v", v), ("u", u))
            for j, joint in enumerate(robot.joints)
        }


def _model(robot: Robot, long: Long) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(mjcf(robot, 1))
    model.opt.timestep, model.opt.integrator = 1.0 / (SUBSTEPS * long.rate), mujoco.mjtIntegrator.mjINT_RK4
    model.dof_damping[long.at] += long.friction
    return model


@dataclass(frozen=True)
class _Desired:
    """Sums of three sines of each joint, whose size grows over the first tenth of the recording."""

    amplitude: Array
    rate: Array
    phase: Array
    grown: float

    @classmethod
    def of(cls, rng: np.random.Generator, n: int, seconds: float) -> "_Desired":
        rate = 2.0 * np.pi * np.array([0.13, 0.31, 0.67])[:, None] * rng.uniform(0.8, 1.25, (3, n))
        amplitude = rng.uniform(0.5, 1.0, (3, n)) * np.array([0.6, 0.35, 0.15])[:, None]
        return cls(amplitude, rate, rng.uniform(0.0, 2.0 * np.pi, (3, n)), 0.1 * seconds)

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """q, v, a (N, n)."""
        angle = time[:, None, None] * self.rate + self.phase
        sine, cosine = np.sin(angle), np.cos(angle)
        q = np.sum(self.amplitude * sine, axis=1)
        v = np.sum(self.amplitude * self.rate * cosine, axis=1)
        a = -np.sum(self.amplitude * self.rate**2 * sine, axis=1)
        s = np.minimum(time / self.grown, 1.0)[:, None]
        size, slope = 0.2 + 0.8 * s**2 * (3.0 - 2.0 * s), 4.8 * s * (1.0 - s) / self.grown
        bend = np.where(s < 1.0, 4.8 * (1.0 - 2.0 * s) / self.grown**2, 0.0)
        return size * q, size * v + slope * q, size * a + 2.0 * slope * v + bend * q
