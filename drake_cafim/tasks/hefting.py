"""Hefting: estimation of the mass of a ball in the palm of a hand that moves up and down (paper, "Mass Estimation").

Rigid model: the ball follows the palm, λ = max(0, m (a + g)) with the palm's acceleration a. The noise std is about
the ball's weight, so that only large accelerations are informative.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.numerics.motion_counts import count_make_breaks, count_reversals
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.model import Jacobians, Rollout, Start
from drake_cafim.tasks.task import Task
from drake_cafim.typing import Array

TRUE_MASS = 0.05  # kg, paper


@dataclass(frozen=True)
class Hefting:
    """The planning model. Motion r is (3,): palm height m, velocity m/s, acceleration m/s² of the last period.

    θ holds the mass, and by their names in `parameters` the force sensor's `bias` (N) and `drift` (N/s, from the start
    of each experiment on): y = λ + bias + drift · t. What has drifted by then is the last component of the state.

    The methods are those of `PlanningModel`.
    """

    parameters: Parameters = field(
        default_factory=lambda: Parameters(
            (Parameter("mass", 1.3 * TRUE_MASS, std=np.sqrt(1e-3), lower=2e-3, upper=1.0, unit="kg"),)
        )
    )
    period: float = 0.05  # s
    substeps: int = 1
    gravity: float = 9.81  # m/s²
    lowest: float = 0.0  # m, paper
    highest: float = 0.6  # m, paper
    speed_limit: float = 1.0  # m/s, paper
    braking_up: float = 7.5  # m/s², below g: the ball stays while the rising palm brakes
    braking_down: float = 20.0  # m/s²
    acceleration_limit: float = np.inf  # m/s², the most by which a real arm follows a change of command
    force_std: float = 0.5  # N
    least_weight: float = 0.1  # fraction of m̂ g below which the predicted force is penalised
    most_weight: float = 6.0  # multiple of m̂ g above which it is
    contact_weight: float = 100.0  # 1 per (m̂ g)
    excess_weight: float = 10.0  # 1 per (force std)²

    @property
    def noise_std(self) -> Array:
        return np.array([self.force_std])

    @property
    def state_size(self) -> int:
        return int(self.drifts)

    @property
    def sensor_errors(self) -> tuple[str, ...]:
        """The parameters that say by how much the force sensor may be off."""
        return ("bias", "drift")

    @property
    def drifts(self) -> bool:
        """Whether the sensor's drift is among the parameters."""
        return "drift" in self.parameters.names

    def of(self, name: str, theta: Array) -> Array:
        """The parameter `name` from θ (..., n); shape (...,)."""
        return np.asarray(theta[..., self.parameters.names.index(name)])

    def column(self, name: str, slope: Array) -> Array:
        """Derivatives (..., k, n) by all parameters, of which that by `name` is `slope` (..., k), the others zero."""
        result = np.zeros((*np.shape(slope), len(self.parameters.names)))
        result[..., self.parameters.names.index(name)] = slope
        return result

    @property
    def velocity_bounds(self) -> tuple[Array, Array]:
        return np.array([-self.speed_limit]), np.array([self.speed_limit])

    def motion(self, robot_state: Array, commands: Array) -> Array:
        """Motion whose velocity changes linearly to each command, limited so that it can stop within the workspace."""
        batch, length = commands.shape[:2]
        states = np.empty((batch, length + 1, 2))
        states[:, 0] = robot_state
        z, v = states[:, 0, 0], states[:, 0, 1]
        for index in range(length):
            coasted = z + 0.5 * self.period * v
            rising = self._fastest(self.highest - coasted, self.braking_up)
            falling = -self._fastest(coasted - self.lowest, self.braking_down)
            most = self.acceleration_limit * self.period
            u = np.clip(commands[:, index, 0], v - most, v + most)
            u = np.maximum(np.minimum(u, rising), falling)
            z, v = coasted + 0.5 * self.period * u, u
            states[:, index + 1, 0], states[:, index + 1, 1] = z, v
        return self.measured_motion(states)

    def _fastest(self, room: Array, braking: float) -> Array:
        """The greatest u (B,) m/s that can still stop in `room` (B,) m: u·period/2 + u²/(2 braking) ≤ room."""
        half = 0.5 * self.period
        root = np.sqrt(half**2 + 2.0 * np.maximum(room, 0.0) / braking)
        return np.asarray(np.where(room >= 0, braking * (root - half), room / half))

    def measured_motion(self, robot_states: Array) -> Array:
        """Motion (B, T·substeps + 1, 3) through measured heights and velocities (B, T+1, 2).

        Each acceleration is that of the period before, constant within it.
        """
        z, v = robot_states[..., 0], robot_states[..., 1]
        if self.substeps == 1:
            a = np.zeros_like(v)
            a[..., 1:] = np.diff(v, axis=-1) / self.period
            return np.stack([z, v, a], axis=-1)
        fraction = np.arange(1, self.substeps + 1) / self.substeps
        acceleration = (np.diff(v, axis=-1) / self.period)[..., np.newaxis]
        elapsed = fraction * self.period
        z0, v0 = z[..., :-1, np.newaxis], v[..., :-1, np.newaxis]
        # constant acceleration misses the measured height by this much; the difference grows linearly over the period
        missed = (np.diff(z, axis=-1) - 0.5 * self.period * (v[..., 1:] + v[..., :-1]))[..., np.newaxis]
        fine_z = z0 + v0 * elapsed + 0.5 * acceleration * elapsed**2 + missed * fraction
        fine_v = v0 + acceleration * elapsed
        fine_a = np.broadcast_to(acceleration, fine_v.shape)
        fine = np.stack([part.reshape(*z.shape[:-1], -1) for part in (fine_z, fine_v, fine_a)], axis=-1)
        first = np.stack([z[..., :1], v[..., :1], np.zeros_like(z[..., :1])], axis=-1)
        return np.concatenate([first, fine], axis=-2)

    def start(self, motion: Array, theta: Array) -> Start:
        return Start(np.zeros(self.state_size), np.zeros((self.state_size, len(theta))))

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        """λ = max(0, m (a + g)), (..., 1)."""
        mass = self.of("mass", theta)[..., np.newaxis]
        return np.asarray(mass * np.maximum(0.0, motion[..., 2:3] + self.gravity))

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        force = self.contact(state, motion, theta)
        shape = motion.shape[:-1]
        slope = self.column("mass", np.maximum(0.0, motion[..., 2:3] + self.gravity))
        return Jacobians(force, np.zeros((*shape, 1, self.state_size)), np.zeros((*shape, 1, 1)), slope)

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        return self.drifted(state, theta) if self.drifts else state

    def drifted(self, state: Array, theta: Array) -> Array:
        """The state (..., nx) with a step's drift in its last component."""
        last = np.zeros(self.state_size)
        last[-1] = self.period / self.substeps
        return np.asarray(state + self.of("drift", theta)[..., np.newaxis] * last)

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        value, shape, nx = self.step(state, motion, following, force, theta), motion.shape[:-1], self.state_size
        slope = np.zeros((*shape, nx, len(theta)))
        if self.drifts:
            slope = slope + self.column("drift", np.full(nx, self.period / self.substeps))
        return Jacobians(value, np.broadcast_to(np.eye(nx), (*shape, nx, nx)), np.zeros((*shape, nx, 1)), slope)

    def measurement(self, state: Array, motion: Array, force: Array, theta: Array) -> Array:
        reading = force
        if "bias" in self.parameters.names:
            reading = reading + self.of("bias", theta)[..., np.newaxis]
        return np.asarray(reading + state[..., -1:]) if self.drifts else reading

    def measurement_jacobians(self, state: Array, motion: Array, force: Array, theta: Array) -> Jacobians:
        by_state = np.zeros((1, self.state_size))
        by_state[:, self.state_size - int(self.drifts) :] = 1.0
        slope = np.zeros((1, len(theta)))
        if "bias" in self.parameters.names:
            slope = self.column("bias", np.ones(1))
        return Jacobians(self.measurement(state, motion, force, theta), by_state, np.eye(1), slope)

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        """Cost (B,) of predicted forces near zero, which lose contact, and far above the weight."""
        weight = self.of("mass", theta) * self.gravity
        force = rollout.forces[..., 0]
        lost = np.maximum(0.0, self.least_weight - force / weight).sum(axis=-1)
        excess = np.maximum(0.0, force - self.most_weight * weight) / self.force_std
        return np.asarray(self.contact_weight * lost + self.excess_weight * (excess**2).sum(axis=-1))

    def touching(self, forces: Array) -> Array:
        return np.asarray(forces[..., 0] > 0)

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        """A fixed motion: slowly up by 0.3 m and down again in 3 s, sinusoidal."""
        return np.array([0.15 * np.pi / 1.5 * np.sin(2.0 * np.pi * time / 3.0)])

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        touching = self.touching(forces)
        return {
            "first_contact": self.period if touching.any() else None,
            "contact_fraction": float(touching.mean()),
            "airborne_fraction": float(1.0 - touching.mean()),
            "sliding_fraction": 0.0,
            "reversals": count_reversals(motion[1:, 1]),
            "make_breaks": count_make_breaks(touching),
            "faces": [],
            "max_force": float(forces[..., 0].max()),
        }


def hefting(model: Hefting | None = None) -> Task:
    """The hefting task: five experiments of 3 s, the palm starting at 0.2 m."""
    return Task(
        name="hefting",
        model=Hefting() if model is None else model,
        truth={"mass": TRUE_MASS},
        robot_start=np.array([0.2, 0.0]),
        periods=60,
        experiments=5,
    )
