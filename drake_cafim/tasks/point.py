"""The base of planning models with a point robot: motion within a box-shaped workspace, fixed environment."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.numerics.motion_counts import count_make_breaks, count_reversals
from drake_cafim.sensitivity.model import Jacobians, Start
from drake_cafim.typing import Array


@dataclass(frozen=True, kw_only=True)
class PointModel:
    """A point that moves at each commanded velocity for a period, within its workspace.

    With an `acceleration_limit` its velocity changes linearly over the period, to the command or as far as possible.

    Motion r is (2 nu,): position m and velocity m/s. The environment is fixed: the state x is empty. The methods are
    those of `PlanningModel`, for subclasses to complete.
    """

    period: float
    workspace_lower: tuple[float, ...]
    workspace_upper: tuple[float, ...]
    speed_limit: float
    careful_speed: float = np.inf  # m/s, limit of plans with a force guard, so that it reacts to unexpected contact
    acceleration_limit: float = np.inf  # m/s², in each coordinate, of a real arm
    substeps: int = 1

    @property
    def state_size(self) -> int:
        return 0

    @property
    def velocity_bounds(self) -> tuple[Array, Array]:
        bound = np.full(len(self.workspace_lower), self.speed_limit)
        return -bound, bound

    def motion(self, robot_state: Array, commands: Array) -> Array:
        """p' = p + u·period, clipped to the workspace, and the mean velocity (p' − p)/period."""
        if np.isfinite(self.acceleration_limit):
            return self.measured_motion(self._accelerated(robot_state, commands))
        size = len(self.workspace_lower)
        lower, upper = np.asarray(self.workspace_lower), np.asarray(self.workspace_upper)
        batch, length = commands.shape[:2]
        result = np.empty((batch, length + 1, 2 * size))
        result[:, 0] = robot_state
        position = np.broadcast_to(robot_state[..., :size], (batch, size))
        for index in range(length):
            following = np.minimum(np.maximum(position + self.period * commands[:, index], lower), upper)
            result[:, index + 1, :size] = following
            result[:, index + 1, size:] = (following - position) / self.period
            position = following
        return self.measured_motion(result)

    def _accelerated(self, robot_state: Array, commands: Array) -> Array:
        """States (B, T+1, 2 nu) with limited acceleration; at the workspace's limits the mean velocity."""
        size, most = len(self.workspace_lower), self.acceleration_limit * self.period
        lower, upper = np.asarray(self.workspace_lower), np.asarray(self.workspace_upper)
        batch, length = commands.shape[:2]
        result = np.empty((batch, length + 1, 2 * size))
        result[:, 0] = robot_state
        for index in range(length):
            position, velocity = result[:, index, :size], result[:, index, size:]
            reached = np.minimum(np.maximum(commands[:, index], velocity - most), velocity + most)
            following = position + 0.5 * self.period * (velocity + reached)
            inside = np.minimum(np.maximum(following, lower), upper)
            result[:, index + 1, :size] = inside
            result[:, index + 1, size:] = np.where(inside == following, reached, (inside - position) / self.period)
        return result

    def measured_motion(self, robot_states: Array) -> Array:
        """The states; between them, at substeps, linear positions and the velocity of the period's end."""
        if self.substeps == 1:
            return robot_states
        size = robot_states.shape[-1] // 2
        fraction = (np.arange(1, self.substeps + 1) / self.substeps)[:, np.newaxis]
        before, after = robot_states[..., :-1, np.newaxis, :], robot_states[..., 1:, np.newaxis, :]
        position = before[..., :size] + fraction * (after[..., :size] - before[..., :size])
        velocity = np.broadcast_to(after[..., size:], position.shape)
        fine = np.concatenate([position, velocity], axis=-1)
        fine = fine.reshape(*robot_states.shape[:-2], -1, 2 * size)
        return np.concatenate([robot_states[..., :1, :], fine], axis=-2)

    def start(self, motion: Array, theta: Array) -> Start:
        return Start(np.zeros(0), np.zeros((0, len(theta))))

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        return state

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        shape = motion.shape[:-1]
        empty = np.zeros((*shape, 0, 0))
        return Jacobians(state, empty, np.zeros((*shape, 0, force.shape[-1])), np.zeros((*shape, 0, len(theta))))

    def measurement(self, state: Array, motion: Array, force: Array, theta: Array) -> Array:
        return force

    def measurement_jacobians(self, state: Array, motion: Array, force: Array, theta: Array) -> Jacobians:
        size = force.shape[-1]
        return Jacobians(force, np.zeros((size, state.shape[-1])), np.eye(size), np.zeros((size, len(theta))))

    def touching(self, forces: Array) -> Array:
        return np.asarray((forces**2).sum(axis=-1) > 0)

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        """Statistics of an executed experiment for run.json, from motion (T+1, 2 nu) and forces (T, nλ)."""
        size = len(self.workspace_lower)
        touching = self.touching(forces)
        first = int(np.argmax(touching)) + 1 if touching.any() else None
        return {
            "first_contact": None if first is None else first * self.period,
            "contact_fraction": float(touching.mean()),
            "airborne_fraction": 0.0,
            "sliding_fraction": 0.0,
            "reversals": max(count_reversals(motion[1:, size + axis]) for axis in range(size)),
            "make_breaks": count_make_breaks(touching),
            "faces": [],
            "max_force": float(np.sqrt((forces**2).sum(axis=-1)).max()),
        }


def force_excess(forces: Array, limit: float) -> Array:
    """Σ_t max(0, |λ| − limit)² (B,) in N², for force magnitudes (B, T)."""
    return np.asarray((np.maximum(0.0, forces - limit) ** 2).sum(axis=-1))
