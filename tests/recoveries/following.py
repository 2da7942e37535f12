"""How well a scene, simulated by Drake, follows a recording, beside what noise and uncertainty let one expect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

from .rig import replayed

LOOK_BACK = 0.05
"""s of samples that the state is taken from."""
ROUNDS = 3
"""Gauss–Newton steps to it."""


@dataclass(frozen=True)
class Following:
    """By column with noise, root mean squares over the horizon in the column's unit."""

    error: Mapping[str, float]
    expected: Mapping[str, float]
    """One standard deviation of noise, start and strengths together."""

    @property
    def worst(self) -> float:
        """The largest error as a multiple of what is expected."""
        return max(self.error[column] / self.expected[column] for column in self.error)


@dataclass(frozen=True)
class Start:
    """Positions and velocities (2n,) at a recording's first sample, and a root (2n, 2n) of their covariance."""

    state: Array
    root: Array


def following(
    scene: Scene, nearby: Sequence[Scene], recording: Recording, start: Start, horizon: float, step: float
) -> Following:
    """The scene's simulation, open loop in the recorded efforts, over `horizon` s after the look back.

    The scenes `nearby` are one standard deviation away, each along one axis of what is not known of the strengths.
    """
    span = LOOK_BACK + horizon
    columns, rows = _columns(scene), slice(_samples(recording, LOOK_BACK) + 1, _samples(recording, span) + 1)

    def simulated(candidate: Scene, state: Array) -> Array:
        found = replayed(candidate, recording, state, span + 1e-9, step)
        return np.stack([found[column] for column in columns])[:, rows]

    base = simulated(scene, start.state)
    moved = [simulated(scene, start.state + axis) - base for axis in start.root.T]
    moved += [simulated(neighbour, start.state) - base for neighbour in nearby]
    noise = np.array([[scene.std(column) or 0.0] for column in columns])
    variance = noise**2 + np.sum(np.square(moved), axis=0)
    error = base - np.stack([recording[column] for column in columns])[:, rows]
    return Following(_root_mean(error**2, columns), _root_mean(variance, columns))


def start_of(scene: Scene, recording: Recording, step: float) -> Start:
    """The state at the first sample with which the scene fits the samples of the look back best.

    By least squares on simulations in Drake; there are no other ideas of the state.
    """
    columns, rows = _columns(scene), slice(0, _samples(recording, LOOK_BACK) + 1)
    std = np.array([scene.std(column) or 0.0 for column in columns])[:, None]
    samples = np.stack([recording[column] for column in columns])[:, rows]

    def residual(state: Array) -> Array:
        found = replayed(scene, recording, state, LOOK_BACK + 1e-9, step)
        return np.asarray((np.stack([found[column] for column in columns])[:, rows] - samples) / std).ravel()

    names = [f"{kind}.{joint}" for kind in "qv" for joint in scene.tree.joint_names]
    sizes = np.array([scene.std(name) or 0.0 for name in names])
    state = np.array([recording[name][0] for name in names])
    for _ in range(ROUNDS):
        now = residual(state)
        jacobian = np.stack([(residual(state + d) - now) / np.sum(d) for d in np.diag(sizes)], axis=1)
        state = state - np.linalg.lstsq(jacobian, now, rcond=None)[0]
    return Start(state, np.linalg.cholesky(np.linalg.inv(jacobian.T @ jacobian)))


def _columns(scene: Scene) -> list[str]:
    kinds = ("q", "v")
    joints = [f"{kind}.{name}" for kind in kinds for name in scene.tree.joint_names]
    wrenches = [
        f"wrench.{sensor.name}.{axis}"
        for sensor in scene.wrench_sensors
        for axis in ("fx", "fy", "fz", "tx", "ty", "tz")
    ]
    return [column for column in (*joints, *wrenches) if scene.std(column)]


def _samples(recording: Recording, duration: float) -> int:
    """How many samples lie in so many s from the first."""
    return int(np.searchsorted(recording.time, recording.time[0] + duration - 1e-9))


def _root_mean(squares: Array, columns: Sequence[str]) -> dict[str, float]:
    return {column: float(np.sqrt(np.mean(row))) for column, row in zip(columns, squares, strict=True)}
