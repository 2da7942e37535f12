"""Rubbing: estimation of the friction coefficient between a tip and a wall (paper, "Friction Estimation")."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw
from drake_cafim.numerics.motion_counts import count_reversals
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.model import Jacobians, Rollout
from drake_cafim.tasks.point import PointModel
from drake_cafim.tasks.task import Task
from drake_cafim.tasks.tilted import TILT, TiltedModel
from drake_cafim.typing import Array

TRUE_FRICTION = 0.4  # 1, paper


@dataclass(frozen=True, kw_only=True)
class Rubbing(TiltedModel):
    """Planner coordinates (x, y) in the wall frame: x away from the wall, which is at x = 0, and y along it.

    Forces λ are (2,): normal, and tangential along y. θ may hold any of friction, stiffness, damping, dissipation,
    modulus and resistance, by the names in `parameters`, `offset` (m), how much nearer than planned the wall is, and
    `tilt` (rad), by which it is turned about its middle.
    With a `slip_velocity` above 0 the friction has that width, as Drake's, and no resistance.
    """

    parameters: Parameters = field(
        default_factory=lambda: Parameters((Parameter("friction", 1.3 * TRUE_FRICTION, std=1.0, lower=0.0, upper=3.0),))
    )
    period: float = 0.02  # s
    workspace_lower: tuple[float, ...] = (0.0, 0.5)  # m, paper
    workspace_upper: tuple[float, ...] = (1.0, 1.0)  # m, paper
    speed_limit: float = 1.0  # m/s, paper
    law: NormalLaw = "kelvin_voigt"
    stiffness: float = 100.0  # N/m, paper
    damping: float = 1.0  # N s/m, paper
    friction: float = TRUE_FRICTION
    resistance: float = 2.0  # N s/m, paper
    dissipation: float = 0.0  # s/m, of hunt_crossley and hydroelastic
    modulus: float = 0.0  # Pa, of hydroelastic
    resolution: float = 0.0  # m, Drake's resolution hint for the tip's mesh, of hydroelastic; 0: an exact sphere
    slip_velocity: float = 0.0  # m/s
    tip_radius: float = 0.04  # m
    force_std: float = 1.0  # N, of each component
    measures_normal: bool = True  # else the tangential force alone
    seeking: float = 0.01  # 1/m

    @property
    def offsets(self) -> tuple[str, ...]:
        """The parameters that say where the contact is relative to the plan."""
        return ("offset",)

    @property
    def pivot(self) -> Array:
        return np.array([0.0, 0.5 * (self.workspace_lower[1] + self.workspace_upper[1])])

    @property
    def noise_std(self) -> Array:
        return np.full(2 if self.measures_normal else 1, self.force_std)

    @property
    def _numbers(self) -> tuple[str, ...]:
        """The names of the law's parameters."""
        width = "slip_velocity" if self.slip_velocity > 0.0 else "resistance"
        return ("stiffness", "damping", "dissipation", "modulus", "friction", width)

    def _contact_parameters(self, theta: Array) -> ContactParameters:
        numbers: dict[str, Any] = {name: getattr(self, name) for name in self._numbers}
        numbers.update({name: theta[..., k] for k, name in enumerate(self.parameters.names)})
        for name in ("offset", TILT):
            numbers.pop(name, None)
        return ContactParameters(**numbers, radius=self.tip_radius, resolution=self.resolution)

    def _penetration(self, motion: Array, theta: Array) -> Array:
        penetration = self.tip_radius - motion[..., 0]
        if "offset" in self.parameters.names:
            penetration = penetration + theta[..., self.parameters.names.index("offset")]
        return np.asarray(penetration)

    def upright_force(self, motion: Array, theta: Array) -> Array:
        parameters, law = self._contact_parameters(theta), ContactLaw(self.law)
        normal = law.normal_force(self._penetration(motion, theta), -motion[..., 2], parameters)
        tangential = law.tangential_force(normal, motion[..., 3:4], parameters)
        # with several θ that have one normal law, as many tangential forces are of one normal force
        along = np.broadcast_to(normal[..., np.newaxis], tangential.shape)
        return np.concatenate([along, tangential], axis=-1)

    def upright_jacobians(self, motion: Array, theta: Array) -> tuple[Jacobians, Array]:
        exact = ContactLaw(self.law).derivatives(
            self._penetration(motion, theta),
            -motion[..., 2],
            motion[..., 3:4],
            self._contact_parameters(theta),
        )
        shape = motion.shape[:-1]
        slope = np.zeros((*shape, 2, len(theta)))
        for column, name in enumerate("penetration" if name == "offset" else name for name in self.parameters.names):
            if name == TILT:
                continue
            slope[..., 0, column] = exact.normal.get(name, 0.0)
            slope[..., 1, column] = exact.tangential[name][..., 0]
        force = np.concatenate([exact.normal_force[..., np.newaxis], exact.tangential_force], axis=-1)
        by_motion = np.zeros((*shape, 2, 4))
        for column, name in ((0, "penetration"), (2, "rate")):
            by_motion[..., 0, column] = -exact.normal[name]
            by_motion[..., 1, column] = -exact.tangential[name][..., 0]
        by_motion[..., 1, 3] = exact.tangential["tangential_velocity"][..., 0, 0]
        return Jacobians(force, np.zeros((2, 0)), np.zeros((2, 2)), slope), by_motion

    def measurement(self, state: Array, motion: Array, force: Array, theta: Array) -> Array:
        return force if self.measures_normal else force[..., 1:]

    def measurement_jacobians(self, state: Array, motion: Array, force: Array, theta: Array) -> Jacobians:
        rows = np.eye(2) if self.measures_normal else np.eye(2)[1:]
        value = self.measurement(state, motion, force, theta)
        return Jacobians(value, np.zeros((len(rows), 0)), rows, np.zeros((len(rows), len(theta))))

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        """Cost (B,) of the mean distance to the wall: without it, plans far from the wall have equal scores."""
        gap = np.maximum(rollout.motion[:, 1:, 0] - self.tip_radius, 0.0)
        return np.asarray(self.seeking * gap.mean(axis=-1))

    def touching(self, forces: Array) -> Array:
        return np.asarray(forces[..., 0] > 0)

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        """A fixed motion: press the tip in by half its radius at up to 0.3 m/s, and slide along at ±0.5 m/s."""
        press = np.clip((0.5 * self.tip_radius - robot_state[0]) / self.period, -0.3, 0.3)
        return np.array([press, -0.5 if (time % 1.0) < 0.5 else 0.5])

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        """Statistics as of `PointModel`; sliding is contact at a speed where λ_t depends on μ, μ λ_n < R |v_t|.

        If `forces` hold the tangential component alone, it is sliding where |λ_t| < R |v_t|.
        """
        viscous = self.resistance * np.abs(motion[1:, 3])
        if self.slip_velocity > 0.0:  # full friction from three times the width on
            viscous = np.where(np.abs(motion[1:, 3]) > 3.0 * self.slip_velocity, np.inf, 0.0)
        if self.measures_normal:
            rubbed = self.friction * forces[:, 0]
        else:
            # |λ_t| = R |v_t| where it does not slide: 1 − 1e-9 keeps rounding from counting as sliding
            rubbed, viscous = np.abs(forces[:, 0]), (1.0 - 1e-9) * viscous
        sliding = (rubbed > 0) & (rubbed < viscous)
        return {
            **PointModel.behaviour(self, motion, np.abs(forces[:, :1])),
            "sliding_fraction": float(sliding.mean()),
            "reversals": count_reversals(motion[1:, 3]),
        }


def rubbing(model: Rubbing | None = None) -> Task:
    """The rubbing task: five experiments of 5 s, starting 0.5 m off the wall."""
    model = Rubbing() if model is None else model
    return Task(
        name="rubbing",
        model=model,
        truth={"friction": TRUE_FRICTION},
        robot_start=np.array([0.5, 0.8, 0.0, 0.0]),
        periods=250,
        experiments=5,
        law=model.law,
    )
