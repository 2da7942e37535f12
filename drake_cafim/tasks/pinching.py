"""Pinching: estimation of the stiffness and damping of a ball in a gripper (paper, "Material Property Estimation")."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.model import Jacobians, Rollout
from drake_cafim.tasks.point import PointModel, force_excess
from drake_cafim.tasks.task import Task
from drake_cafim.typing import Array

TRUE_STIFFNESS, TRUE_DAMPING = 800.0, 10.0  # N/m and N s/m, paper


@dataclass(frozen=True, kw_only=True)
class Pinching(PointModel):
    """Planner coordinate: a jaw's distance m from the ball's centre; both jaws mirror each other. λ (1,) is normal.

    θ holds the law's parameters by the names in `parameters`: stiffness and damping, or, of `hunt_crossley`, stiffness
    and dissipation (s/m), or, of `hydroelastic`, modulus (Pa) and dissipation. `offset` (m), where it is among them, is
    how much nearer than planned the surface is.
    """

    parameters: Parameters = field(
        default_factory=lambda: Parameters(
            (
                Parameter("stiffness", 1.3 * TRUE_STIFFNESS, std=100.0, lower=10.0, upper=5e3, unit="N/m"),
                Parameter("damping", 1.3 * TRUE_DAMPING, std=10.0, lower=0.0, upper=100.0, unit="N s/m"),
            )
        )
    )
    period: float = 0.02  # s
    workspace_lower: tuple[float, ...] = (0.002,)  # m
    workspace_upper: tuple[float, ...] = (0.037,)  # m
    speed_limit: float = 0.3  # m/s
    law: NormalLaw = "kelvin_voigt"
    ball_radius: float = 0.020  # m
    resolution: float = 0.0  # m, Drake's resolution hint for the ball's mesh, of hydroelastic; 0: an exact sphere
    force_std: float = 2.0  # N
    force_limit: float = 10.0  # N
    force_weight: float = 0.2  # 1/N²

    @property
    def offsets(self) -> tuple[str, ...]:
        """The parameters that say where the contact is relative to the plan."""
        return ("offset",)

    @property
    def noise_std(self) -> Array:
        return np.array([self.force_std])

    def _contact_parameters(self, theta: Array) -> ContactParameters:
        numbers = {name: theta[..., k] for k, name in enumerate(self.parameters.names)}
        numbers.pop("offset", None)
        return ContactParameters(**numbers, radius=self.ball_radius, resolution=self.resolution)

    def _penetration(self, motion: Array, theta: Array) -> Array:
        penetration = self.ball_radius - motion[..., 0]
        if "offset" in self.parameters.names:
            penetration = penetration + theta[..., self.parameters.names.index("offset")]
        return np.asarray(penetration)

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        penetration = self._penetration(motion, theta)
        force = ContactLaw(self.law).normal_force(penetration, -motion[..., 1], self._contact_parameters(theta))
        return force[..., np.newaxis]

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        exact = ContactLaw(self.law).derivatives(
            self._penetration(motion, theta),
            -motion[..., 1],
            np.zeros((*motion.shape[:-1], 1)),
            self._contact_parameters(theta),
        )
        by_name = {**exact.normal, "offset": exact.normal["penetration"]}
        slope = np.stack([by_name[name] for name in self.parameters.names], axis=-1)[..., np.newaxis, :]
        return Jacobians(exact.normal_force[..., np.newaxis], np.zeros((1, 0)), np.zeros((1, 1)), slope)

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        """Cost (B,) of predicted force above the limit, w Σ_t max(0, λ − limit)²."""
        return self.force_weight * force_excess(rollout.forces[..., 0], self.force_limit)

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        """A fixed motion: slow squeeze and release between 0.024 m and 0.014 m, once a second."""
        return np.array([-0.02 if (time % 1.0) < 0.5 else 0.02])

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        return PointModel.behaviour(self, motion, forces)


WORKING_FORCE = 4.0  # N, at which Hunt and Crossley's dissipation d damps as much as the paper's C = d · force
TRUE_DISSIPATION = TRUE_DAMPING / WORKING_FORCE  # s/m


def hunt_crossley_pinching() -> Pinching:
    """Pinching with the law of Drake's point contact; θ is stiffness and dissipation, with the same relative priors."""
    stiffness, damping = Pinching().parameters.free
    ratio = 1.0 / WORKING_FORCE
    dissipation = Parameter(
        "dissipation", ratio * damping.mean, std=ratio * damping.std, lower=0.0, upper=ratio * damping.upper, unit="s/m"
    )
    return Pinching(law="hunt_crossley", parameters=Parameters((stiffness, dissipation)))


def pinching(model: Pinching | None = None) -> Task:
    """The pinching task: five experiments of 1 s, starting 4 mm off the ball."""
    model = Pinching() if model is None else model
    truth = {"stiffness": TRUE_STIFFNESS, "damping": TRUE_DAMPING, "dissipation": TRUE_DISSIPATION}
    return Task(
        name="pinching",
        model=model,
        truth={name: truth[name] for name in model.parameters.names if name in truth},
        robot_start=np.array([0.024, 0.0]),
        periods=50,
        experiments=5,
        law=model.law,
    )
