"""Hefting on a soft palm: the ball has a height and a velocity of its own, and may leave the hand."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw, normal_force_derivatives
from drake_cafim.sensitivity.model import Jacobians, Start
from drake_cafim.tasks.hefting import Hefting
from drake_cafim.typing import Array


@dataclass(frozen=True)
class CompliantHefting(Hefting):
    """State x is (2,): ball height m (0 on the palm's surface at palm height 0) and velocity m/s.

    m z̈ = λ(d, ḋ) − m g with penetration d = z_palm − z_ball, by semi-implicit Euler: velocity, then height.
    With the paper's C = 0 the open palm is chaotic; C = 5 N s/m is ours.
    """

    substeps: int = 20
    law: NormalLaw = "kelvin_voigt"
    stiffness: float = 500.0  # N/m, paper
    damping: float = 5.0  # N s/m
    dissipation: float = 0.0  # s/m, of hunt_crossley
    smoothing: float = 0.0  # N, of the contact law

    @property
    def state_size(self) -> int:
        return 2

    @property
    def _parameters(self) -> ContactParameters:
        return ContactParameters(stiffness=self.stiffness, damping=self.damping, dissipation=self.dissipation)

    def start(self, motion: Array, theta: Array) -> Start:
        """The ball at rest, sunk in by m g / K: an equilibrium that depends on the mass, so S_0 is not zero."""
        sunk = self.gravity / self.stiffness
        return Start(np.array([motion[0] - theta[0] * sunk, motion[1]]), np.array([[-sunk], [0.0]]))

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
            stiffness=self.stiffness,
            damping=self.damping,
            dissipation=self.dissipation,
            smoothing=self.smoothing,
        )
        slope = np.empty((*rate.shape, 1, 2))
        slope[..., 0, 0], slope[..., 0, 1] = -exact.wrt_penetration, -exact.wrt_rate
        return Jacobians(exact.force[..., np.newaxis], slope, np.zeros((1, 1)), np.zeros((*rate.shape, 1, 1)))

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        h = self.period / self.substeps
        velocity = state[..., 1] + h * (force[..., 0] / theta[0] - self.gravity)
        return np.stack([state[..., 0] + h * velocity, velocity], axis=-1)

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        h = self.period / self.substeps
        value = self.step(state, motion, following, force, theta)
        push = np.array([[h * h], [h]])
        slope = -(force[..., 0] / theta[0] ** 2)[..., np.newaxis, np.newaxis] * push
        return Jacobians(value, np.array([[1.0, h], [0.0, 1.0]]), push / theta[0], slope)
