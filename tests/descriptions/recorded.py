"""Recordings of a robot in MuJoCo under a computed-torque controller that sees its own noisy sensors."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
import pandas as pd

from drake_cafim.typing import Array
from tests.descriptions.hidden import Hidden
from tests.descriptions.mujoco_robot import SUBSTEP, Robot

STEP, PARTS = 0.004, 16
"""s between samples, and MuJoCo's steps in one."""
DURATION = 4.0
NAMES = ("train_1.parquet", "train_2.parquet", "train_3.parquet", "held_1.parquet")
NOISE_Q, NOISE_V = (2.0e-4, 2.0e-5), (2.0e-3, 2.0e-4)
"""Std of a sample of a joint that turns (rad, rad/s) and of one that slides (m, m/s)."""
WIDEST = (1.2, 0.3)
"""rad and m from zero that joints without nearer limits go."""
FASTEST = (1.5, 0.4)
"""rad/s and m/s."""
BANDWIDTH, DAMPING_RATIO = 8.0, 0.8
"""rad/s of the controller, and its damping."""
MADE_UP, SLOW = 0.9, 0.05
"""The share of the friction that the file states for which the controller makes up, and the speed (rad/s, m/s) above
which it does."""
START = 0.6
"""s from rest to the full motion."""
RATES = 2.0 * np.pi * np.array([0.3, 0.7, 1.3])
SHARES = np.array([0.6, 0.28, 0.12])


@dataclass(frozen=True)
class Desired:
    """Desired motions of all recordings: q, v, a (R, N, n) at the samples."""

    q: Array
    v: Array
    a: Array


def desired(rng: np.random.Generator, limits: Array, sliding: Array, scale: float) -> Desired:
    """Three sines a joint from rest, within `limits` (n, 2); `sliding` (n,) marks prismatic joints."""
    kind = sliding.astype(int)
    # limits that are equal are written for joints that have none
    limits = np.where(limits[:, :1] < limits[:, 1:], limits, [-np.inf, np.inf])
    widest, fastest = np.take(WIDEST, kind), np.take(FASTEST, kind)
    low, high = np.maximum(limits[:, 0], -widest), np.minimum(limits[:, 1], widest)
    low, high = np.minimum(low, high - 0.2 * widest), np.maximum(high, low + 0.2 * widest)
    low, high = np.maximum(low, limits[:, 0]), np.minimum(high, limits[:, 1])
    time = STEP * np.arange(round(DURATION / STEP))
    s = np.clip(time / START, 0.0, 1.0)[:, None]
    ramp = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    ramp1 = 30.0 * s**2 * (1.0 - s) ** 2 / START
    ramp2 = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / START**2
    runs = []
    for _ in NAMES:
        rate = RATES[:, None] * rng.uniform(0.8, 1.2, (3, len(low)))
        phase = rng.uniform(0.0, 2.0 * np.pi, rate.shape)
        reach = scale * np.minimum(0.35 * (high - low), fastest / (SHARES @ rate))
        size = SHARES[:, None] * reach
        angle = rate * time[:, None, None] + phase
        x, x1, x2 = (size * f for f in (np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle)))
        x, x1, x2 = (item.sum(axis=1) for item in (x, x1, x2))
        middle = 0.5 * (low + high) + rng.uniform(-0.1, 0.1, len(low)) * (high - low)
        runs.append((middle + ramp * x, ramp1 * x + ramp * x1, ramp2 * x + 2.0 * ramp1 * x1 + ramp * x2))
    return Desired(*(np.stack(parts) for parts in zip(*runs, strict=True)))


def within_limits(rng: np.random.Generator, robot: Robot, limits: Array, sliding: Array, efforts: Array) -> Desired:
    """Desired motions that need at most 0.7 of the effort limits (n,); slower ones are drawn until they do.

    Raises `ValueError` where even small motions need more.
    """
    scale = 1.0
    for _ in range(8):
        wanted = desired(rng, limits, sliding, scale)
        needed = robot.inverse(*(x[:, ::10].reshape(-1, len(sliding)) for x in (wanted.q, wanted.v, wanted.a)))
        if np.all(np.abs(needed).max(axis=0) <= 0.7 * efforts):
            return wanted
        scale *= 0.7
    raise ValueError("the motors are too weak for any motion about the middle of the joints' ranges")


def record(
    rng: np.random.Generator, nominal: Robot, robot: Robot, wanted: Desired, hidden: Hidden, sliding: Array
) -> Mapping[str, pd.DataFrame]:
    """The recordings of `robot` with what `hidden` adds; the controller believes in `nominal`."""
    tables = {}
    for r, name in enumerate(NAMES):
        tables[name] = _one(rng, nominal, robot, Desired(wanted.q[r], wanted.v[r], wanted.a[r]), hidden, sliding)
    return tables


def _one(
    rng: np.random.Generator, nominal: Robot, robot: Robot, wanted: Desired, hidden: Hidden, sliding: Array
) -> pd.DataFrame:
    samples, n = wanted.q.shape
    kind = sliding.astype(int)
    noise_q = np.take(NOISE_Q, kind) * rng.standard_normal((samples, n))
    noise_v = np.take(NOISE_V, kind) * rng.standard_normal((samples, n))
    against_friction = MADE_UP * nominal.frictions * np.tanh(wanted.v / SLOW)
    data = mujoco.MjData(robot.model)
    data.qpos[robot.places], data.qvel[robot.degrees] = wanted.q[0], wanted.v[0]
    u, dense = np.zeros((samples, n)), np.zeros((samples * PARTS, 2, n))
    for k in range(samples):
        q, v = data.qpos[robot.places], data.qvel[robot.degrees]
        q, v = q + noise_q[k], v + noise_v[k]
        a = wanted.a[k] + BANDWIDTH**2 * (wanted.q[k] - q) + 2.0 * DAMPING_RATIO * BANDWIDTH * (wanted.v[k] - v)
        u[k] = nominal.inverse(q[None], v[None], a[None])[0] + against_friction[k]
        for part in range(PARTS):
            row = k * PARTS + part
            dense[row] = data.qpos[robot.places], data.qvel[robot.degrees]
            robot.drive(data, hidden.acting(u, row, PARTS))
            mujoco.mj_step(robot.model, data)
    if not np.all(np.isfinite(dense)):
        raise ValueError("the motion diverges")
    read_q, read_v = hidden.read(dense[:, 0], dense[:, 1], PARTS)
    columns = {f"q.{name}": (read_q + noise_q)[:, j] for j, name in enumerate(robot.names)}
    columns |= {f"v.{name}": (read_v + noise_v)[:, j] for j, name in enumerate(robot.names)}
    columns |= {f"u.{name}": u[:, j] for j, name in enumerate(robot.names)}
    return pd.DataFrame({"time": np.round(PARTS * SUBSTEP * np.arange(samples), 9), **columns})
