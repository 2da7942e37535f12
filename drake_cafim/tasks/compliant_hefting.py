"""Hefting with a compliant palm: the ball has its own height and velocity, and may lose contact."""

from dataclasses import dataclass
from typing import final

import numpy as np

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NORMAL_LAWS, NormalLaw, normal_force_at, normal_force_derivatives
from drake_cafim.numerics.compiled import compiled
from drake_cafim.sensitivity.model import Jacobians, Rollout, Start
from drake_cafim.tasks.hefting import Hefting
from drake_cafim.typing import Array


@final
@dataclass(frozen=True)
class CompliantHefting(Hefting):
    """Hefting with state x (2,): ball height m (0 on the palm's surface at palm height 0) and velocity m/s.

    m z̈ = λ(d, ḋ) − m g with penetration d = z_palm − z_ball, by semi-implicit Euler: velocity, then height.
    With the paper's C = 0 the bouncing ball is chaotic; the default C = 5 N s/m is not the paper's.
    """

    substeps: int = 20
    law: NormalLaw = "kelvin_voigt"
    stiffness: float = 500.0  # N/m, paper
    damping: float = 5.0  # N s/m
    dissipation: float = 0.0  # s/m, of hunt_crossley
    smoothing: float = 0.0  # N, of the contact law

    @property
    def state_size(self) -> int:
        return 2 + int(self.drifts)

    @property
    def _parameters(self) -> ContactParameters:
        return ContactParameters(stiffness=self.stiffness, damping=self.damping, dissipation=self.dissipation)

    def start(self, motion: Array, theta: Array) -> Start:
        """The ball at rest with penetration m g / K: the equilibrium depends on the mass, so that S_0 is not zero."""
        sunk, drift = self.gravity / self.stiffness, np.zeros(int(self.drifts))
        state = np.concatenate([[motion[0] - self.of("mass", theta) * sunk, motion[1]], drift])
        return Start(state, self.column("mass", np.concatenate([[-sunk, 0.0], drift])))

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        penetration, rate = motion[..., 0] - state[..., 0], motion[..., 1] - state[..., 1]
        force = ContactLaw(self.law, self.smoothing).normal_force(penetration, rate, self._parameters)
        return force[..., np.newaxis]

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        penetration, rate = motion[..., 0] - state[..., 0], motion[..., 1] - state[..., 1]
        exact = normal_force_derivatives(
            self.law,
            penetration,
            rate,
            **self._parameters.of_normal(self.law),
            smoothing=self.smoothing,
        )
        slope = np.zeros((*rate.shape, 1, self.state_size))
        slope[..., 0, 0], slope[..., 0, 1] = -exact.wrt_penetration, -exact.wrt_rate
        return Jacobians(exact.force[..., np.newaxis], slope, np.zeros((1, 1)), np.zeros((*rate.shape, 1, len(theta))))

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        h = self.period / self.substeps
        velocity = state[..., 1] + h * (force[..., 0] / self.of("mass", theta) - self.gravity)
        moved = np.stack([state[..., 0] + h * velocity, velocity], axis=-1)
        return self.drifted(np.concatenate([moved, state[..., 2:]], axis=-1), theta) if self.drifts else moved

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        h = self.period / self.substeps
        value = self.step(state, motion, following, force, theta)
        mass, nx = self.of("mass", theta), self.state_size
        push, forward = np.zeros(nx), np.eye(nx)
        push[:2], forward[0, 1] = (h * h, h), h
        slope = self.column("mass", -(force / mass**2) * push)
        if self.drifts:
            slope = slope + self.column("drift", np.array([0.0, 0.0, h]))
        return Jacobians(value, forward, push[:, np.newaxis] / mass, slope)

    def rollout(self, motion: Array, theta: Array, start: Start) -> Rollout:
        """The same as `contact`, `step` and their Jacobians step by step, in one compiled loop (`FastRollout`)."""
        batch, mass = motion.shape[0], self.parameters.names.index("mass")
        numbers = self._parameters.of_normal(self.law)
        field = (float(numbers.get("narrowing", 1.0)), float(numbers.get("deficit", 0.0)))
        loss = (float(numbers.get("damping", 0.0)), float(numbers["dissipation"]))
        law = (NORMAL_LAWS.index(self.law), float(numbers["stiffness"]), *loss, *field, self.smoothing)
        states, tangents, forces, slopes = _integrate(
            np.ascontiguousarray(motion),
            np.broadcast_to(start.state[..., :2], (batch, 2)),
            np.broadcast_to(start.sensitivity[..., :2, mass : mass + 1], (batch, 2, 1)),
            float(theta[mass]),
            law,
            self.gravity,
            self.period / self.substeps,
            self.substeps,
        )
        made = Rollout(motion[:, :: self.substeps], states, forces, forces, slopes, tangents)
        return made if len(theta) == 1 else self._with_sensor(made, theta, start)

    def _with_sensor(self, made: Rollout, theta: Array, start: Start) -> Rollout:
        """The rollout with the sensor's bias and drift, of which `made` knows the mass alone."""
        names, time = self.parameters.names, self.period * np.arange(made.states.shape[1])
        G = self.column("mass", made.sensitivities[..., 0])
        S, states, readings = self.column("mass", made.state_sensitivities[..., 0]), made.states, made.measurements
        if "bias" in names:
            readings = readings + self.of("bias", theta)
            G = G + self.column("bias", np.ones(1))
        if self.drifts:
            passed = np.broadcast_to(start.state[..., -1:], (len(states), 1)) + time * self.of("drift", theta)
            slope = np.broadcast_to(start.sensitivity[..., -1:, :], (len(states), len(time), len(theta)))
            slope = slope + self.column("drift", time)
            states = np.concatenate([states, passed[..., np.newaxis]], axis=-1)
            S = np.concatenate([S, slope[..., np.newaxis, :]], axis=-2)
            readings, G = readings + passed[:, 1:, np.newaxis], G + slope[:, 1:, np.newaxis]
        return Rollout(made.motion, states, made.forces, readings, G, S)


@compiled
def _integrate(
    motion: Array,
    state: Array,
    tangent: Array,
    mass: float,
    law: tuple[int, float, float, float, float, float, float],
    gravity: float,
    h: float,
    substeps: int,
) -> tuple[Array, Array, Array, Array]:
    """The ball's state at the ends of periods, the force after each period, and the derivatives of both by the mass.

    States (B, T+1, 2), tangents (B, T+1, 2, 1), forces (B, T, 1), slopes (B, T, 1, 1), from states (B, 2) and tangents
    (B, 2, 1), along motion (B, T·substeps + 1, 3).
    """
    which, stiffness, damping, dissipation, narrowing, deficit, smoothing = law
    batch, length = motion.shape[:2]
    periods = (length - 1) // substeps
    states, tangents = np.empty((batch, periods + 1, 2)), np.empty((batch, periods + 1, 2, 1))
    forces, slopes = np.empty((batch, periods, 1)), np.empty((batch, periods, 1, 1))
    for b in range(batch):
        z, v = state[b, 0], state[b, 1]
        dz, dv = tangent[b, 0, 0], tangent[b, 1, 0]
        force, slope = 0.0, 0.0
        states[b, 0], tangents[b, 0, 0, 0], tangents[b, 0, 1, 0] = state[b], dz, dv
        for i in range(length):
            if i > 0:
                dv += h * (slope / mass - force / mass**2)
                dz += h * dv
                v += h * (force / mass - gravity)
                z += h * v
            at = normal_force_at(
                which,
                motion[b, i, 0] - z,
                motion[b, i, 1] - v,
                stiffness,
                damping,
                dissipation,
                narrowing,
                deficit,
                smoothing,
            )
            force, slope = at[0], -at[1] * dz - at[2] * dv
            if i > 0 and i % substeps == 0:
                k = i // substeps
                states[b, k, 0], states[b, k, 1] = z, v
                tangents[b, k, 0, 0], tangents[b, k, 1, 0] = dz, dv
                forces[b, k - 1, 0], slopes[b, k - 1, 0, 0] = force, slope
    return states, tangents, forces, slopes
