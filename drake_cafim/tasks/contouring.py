"""Contouring: estimation of a box's length and width by touching its sides (paper, "Shape Estimation")."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drake_cafim.contact.edge import wedge_volume
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw
from drake_cafim.contact.pressure import surface_deficit
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.model import Jacobians, Rollout
from drake_cafim.tasks.point import PointModel, force_excess
from drake_cafim.tasks.task import Task
from drake_cafim.tasks.tilted import TILT, TiltedModel
from drake_cafim.typing import Array

TRUE_LENGTH, TRUE_WIDTH = 0.126, 0.05  # m, paper
FACES = ("+x", "-x", "+y", "-y")
LAW_PARAMETERS = ("stiffness", "dissipation")
CLEARANCE = 0.02  # m, kept from where a face is expected on the way around the box


@dataclass(frozen=True, kw_only=True)
class Contouring(TiltedModel):
    """Planner coordinates (x, y) in the plane of the table; a round tip against a fixed box, no friction.

    λ is (2,), the force on the tip, K (r − distance) along the box's outward normal at the nearest point, or that of
    Drake's pressure field (`contact/edge.py`). Of the first: as the
    tip's centre approaches a corner, the derivative of that normal, and with it the information, grows without
    bound; hence within `corner_radius` of a corner the direction is b / corner_radius, shorter than one, with b the
    vector from the corner.

    θ holds length and width, and by their names in `parameters` any of stiffness, dissipation and modulus, and
    `offset_x` and `offset_y` (m), the place of the box's centre relative to `centre`, and `tilt` (rad).
    """

    parameters: Parameters = field(
        default_factory=lambda: Parameters(
            (
                Parameter("length", 1.3 * TRUE_LENGTH, std=np.sqrt(1e-3), lower=0.01, upper=0.35, unit="m"),
                Parameter("width", 1.3 * TRUE_WIDTH, std=np.sqrt(1e-3), lower=0.01, upper=0.25, unit="m"),
            )
        )
    )
    period: float = 0.05  # s
    workspace_lower: tuple[float, ...] = (0.3, -0.15)  # m, paper
    workspace_upper: tuple[float, ...] = (0.8, 0.15)  # m, paper
    speed_limit: float = 0.5  # m/s, paper
    careful_speed: float = 0.17  # m/s
    law: NormalLaw = "kelvin_voigt"  # of the force at the tip's deepest point, without damping but for a dissipation
    stiffness: float = 500.0  # N/m, paper
    dissipation: float = 0.0  # s/m, of hunt_crossley and hydroelastic
    modulus: float = 0.0  # Pa, of hydroelastic
    height: float = 0.1  # m, of the box; the pressure of hydroelastic grows over half its smallest extent
    resolution: float = 0.0  # m, Drake's resolution hint for the tip's mesh, of hydroelastic
    centre: tuple[float, float] = (0.5, 0.0)  # m
    tip_radius: float = 0.01  # m
    corner_radius: float = 0.002  # m, within which a corner's force decreases linearly to zero
    force_std: float = 3.0  # N, of each component
    force_limit: float = 10.0  # N
    force_weight: float = 0.2  # 1/N²
    seeking: float = 0.01  # 1/m

    @property
    def offsets(self) -> tuple[str, ...]:
        """The parameters that say where the contact is relative to the plan."""
        return ("offset_x", "offset_y")

    @property
    def pivot(self) -> Array:
        return np.asarray(self.centre)

    @property
    def noise_std(self) -> Array:
        return np.full(2, self.force_std)

    def _named(self, theta: Array) -> dict[str, Array]:
        """The parameters by name, from θ (..., n)."""
        return dict(zip(self.parameters.names, np.moveaxis(np.asarray(theta), -1, 0), strict=True))

    def _centre(self, named: Mapping[str, Array]) -> Array:
        """The box's centre (..., 2) m."""
        centre = np.asarray(self.centre)
        if "offset_x" not in named:
            return centre
        return np.asarray(centre + np.stack([named["offset_x"], named["offset_y"]], axis=-1))

    def _contact_parameters(self, named: Mapping[str, Array]) -> ContactParameters:
        numbers: dict[str, Any] = {name: named.get(name, getattr(self, name)) for name in ("stiffness", "dissipation")}
        return ContactParameters(**numbers)

    def _beyond(self, motion: Array, named: Mapping[str, Array]) -> Array:
        """How far the tip's centre is beyond each pair of sides, (..., 2) m; negative between them."""
        return np.asarray(np.abs(motion[..., :2] - self._centre(named)) - 0.5 * _size(named))

    def distance(self, motion: Array, theta: Array) -> Array:
        """Signed distance (...,) m from the tip's surface to the box."""
        return _signed_distance(self._beyond(self.upright_motion(motion, theta), self._named(theta))) - self.tip_radius

    def _sides(self, motion: Array, named: Mapping[str, Array]) -> Array:
        return np.where(motion[..., :2] >= self._centre(named), 1.0, -1.0)

    def _field(self, named: Mapping[str, Any]) -> tuple[Any, Any, Any]:
        """Gradient (Pa/m) and dissipation (s/m) of the box's pressure field, and the radius (m) of the tip's mesh."""
        least = np.minimum(np.minimum(named["length"], named["width"]), self.height)
        modulus, loss = (named.get(name, getattr(self, name)) for name in ("modulus", "dissipation"))
        return modulus / (0.5 * least), loss, self.tip_radius - surface_deficit(self.tip_radius, self.resolution)

    def _field_force(self, motion: Array, named: Mapping[str, Any]) -> Array:
        """λ of the law `hydroelastic`: of each pair of faces the volume nearest to it times the field's gradient."""
        (gradient, loss, radius), sides = self._field(named), self._sides(motion, named)
        beyond = self._beyond(motion, named) / radius
        volumes = [wedge_volume(beyond[..., axis], beyond[..., 1 - axis])[0] for axis in range(2)]
        through = 1.0 - np.asarray(loss)[..., np.newaxis] * sides * motion[..., 2:4]
        scale = np.asarray(gradient * radius**3)[..., np.newaxis]
        return np.asarray(scale * np.stack(volumes, axis=-1) * np.maximum(through, 0.0) * sides)

    def _field_jacobians(self, motion: Array, theta: Array) -> tuple[Jacobians, Array]:
        """`_field_force` with its derivatives: those of a volume are areas, see `wedge_volume`."""
        named = self._named(theta)
        (gradient, loss, radius), sides = self._field(named), self._sides(motion, named)
        beyond = self._beyond(motion, named) / radius
        volume, by_beyond = np.empty(beyond.shape), np.empty((*beyond.shape, 2))
        for axis in range(2):
            found = wedge_volume(beyond[..., axis], beyond[..., 1 - axis])
            volume[..., axis], by_beyond[..., axis, axis], by_beyond[..., axis, 1 - axis] = found
        rate = -sides * motion[..., 2:4]
        through = np.maximum(1.0 + loss * rate, 0.0)
        force = gradient * radius**3 * volume * through * sides
        by_size = -0.5 * gradient * radius**2 * by_beyond * (through * sides)[..., np.newaxis]
        by_name = {"length": by_size[..., 0], "width": by_size[..., 1]}
        by_name |= {"offset_x": 2.0 * sides[..., :1] * by_size[..., 0]}
        by_name |= {"offset_y": 2.0 * sides[..., 1:] * by_size[..., 1]}
        within = gradient * radius**3 * volume * np.where(through > 0.0, 1.0, 0.0)
        by_name |= {"dissipation": within * rate * sides, TILT: np.zeros_like(volume)}
        by_place = -np.stack([by_name["offset_x"], by_name["offset_y"]], axis=-1)
        by_motion = np.concatenate([by_place, -(loss * within)[..., np.newaxis] * np.eye(2)], axis=-1)
        if "modulus" in named:
            by_name |= {"modulus": force / named["modulus"]}
        smallest = min(("length", "width"), key=lambda name: float(named[name]))
        if float(named[smallest]) < self.height:  # the field's gradient is the modulus over half the smallest extent
            by_name[smallest] = by_name[smallest] - force / named[smallest]
        slope = np.stack([by_name[name] for name in self.parameters.names], axis=-1)
        return Jacobians(force, np.zeros((2, 0)), np.zeros((2, 2)), slope), by_motion

    def upright_force(self, motion: Array, theta: Array) -> Array:
        named = self._named(theta)
        if self.law == "hydroelastic":
            return self._field_force(motion, named)
        beyond, sides = self._beyond(motion, named), self._sides(motion, named)
        depth = self.tip_radius - _signed_distance(beyond)
        rate = -(_gradient(beyond) * sides * motion[..., 2:4]).sum(axis=-1)
        size = ContactLaw(self.law).normal_force(depth, rate, self._contact_parameters(named))
        return np.asarray(size[..., np.newaxis] * self._direction(beyond) * sides)

    def upright_jacobians(self, motion: Array, theta: Array) -> tuple[Jacobians, Array]:
        """With b = |p − c| − θ/2, distance s(b) and direction n(b): λ = N(r − s, ḋ) σ∘n, and ∂b/∂θ = −½.

        Hence ∂λ/∂θ = ½ σ∘(N_d n ∇sᵀ − N ∂n/∂b − N_ḋ n (∂ḋ/∂b)ᵀ); ∂n/∂b and ∂ḋ/∂b are zero but at corners.
        """
        if self.law == "hydroelastic":
            return self._field_jacobians(motion, theta)
        named = self._named(theta)
        beyond, sides = self._beyond(motion, named), self._sides(motion, named)
        distance = _signed_distance(beyond)
        direction, gradient = self._direction(beyond), _gradient(beyond)
        along = sides * motion[..., 2:4]
        parameters = self._contact_parameters(named)
        exact = ContactLaw(self.law).derivatives(
            self.tip_radius - distance, -(gradient * along).sum(axis=-1), np.zeros((*distance.shape, 1)), parameters
        )
        normal, by_depth, by_rate = (
            values[..., np.newaxis, np.newaxis]
            for values in (exact.normal_force, exact.normal["penetration"], exact.normal["rate"])
        )
        corner = (beyond > 0).all(axis=-1)
        radius = np.maximum(np.where(corner, distance, 1.0), self.corner_radius)
        turning = np.where(corner & (distance > self.corner_radius), 1.0, 0.0)[..., np.newaxis, np.newaxis]
        bend = np.where(corner, 1.0 / radius, 0.0)[..., np.newaxis, np.newaxis]
        curvature = bend * (np.eye(2) - turning * _outer(direction, direction))
        curl = np.where(corner, 1.0 / np.where(corner, distance, 1.0), 0.0)[..., np.newaxis, np.newaxis]
        bending = curl * (np.eye(2) - _outer(gradient, gradient))  # ∂²s/∂b²
        turned = -np.einsum("...ij,...j->...i", bending, along)  # ∂ḋ/∂b
        slope = by_depth * _outer(direction, gradient) - normal * curvature - by_rate * _outer(direction, turned)
        across = (direction * sides)[..., np.newaxis]
        by_size = 0.5 * sides[..., np.newaxis] * slope
        by_name = {name: across[..., 0] * exact.normal[name][..., np.newaxis] for name in LAW_PARAMETERS}
        by_name |= {"offset_x": 2.0 * sides[..., :1] * by_size[..., 0]}
        by_name |= {"offset_y": 2.0 * sides[..., 1:] * by_size[..., 1]}
        by_name |= {"length": by_size[..., 0], "width": by_size[..., 1]}
        by_name |= {TILT: np.zeros_like(direction)}
        columns = [np.broadcast_to(by_name[name], across.shape[:-1]) for name in self.parameters.names]
        by_place = -np.stack([by_name["offset_x"], by_name["offset_y"]], axis=-1)
        by_motion = np.concatenate([by_place, -by_rate * _outer(direction * sides, gradient * sides)], axis=-1)
        force = normal[..., 0] * direction * sides
        return Jacobians(force, np.zeros((2, 0)), np.zeros((2, 2)), np.stack(columns, axis=-1)), by_motion

    def _direction(self, beyond: Array) -> Array:
        """n(b), (..., 2): the gradient of the distance, but within `corner_radius` of a corner b / corner_radius."""
        corner = (beyond[..., 0] > 0) & (beyond[..., 1] > 0)
        distance = np.where(corner, _signed_distance(beyond), 1.0 + 0.0 * beyond[..., 0])
        shorter = np.where(distance < self.corner_radius, distance / self.corner_radius, 1.0)
        return np.asarray(np.asarray(shorter)[..., np.newaxis] * _gradient(beyond))

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        """Cost (B,) of predicted force above the limit, w Σ_t max(0, |λ| − limit)², and of mean distance to the box."""
        size = np.sqrt((rollout.forces**2).sum(axis=-1))
        gap = np.maximum(self.distance(rollout.motion[:, 1:], theta), 0.0).mean(axis=-1)
        return np.asarray(self.force_weight * force_excess(size, self.force_limit) + self.seeking * gap)

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        """A fixed motion that touches the near long side once and then the right end once, each about 1 cm deep."""
        legs = (  # until s, velocity m/s
            (0.3, (0.0, 0.25)),
            (0.6, (0.0, -0.25)),
            (1.1, (0.3, 0.0)),
            (1.6, (0.0, 0.2)),
            (1.95, (-0.25, 0.0)),
            (2.3, (0.25, 0.0)),
        )
        for until, velocity in legs:
            if time < until - 1e-9:
                return np.array(velocity)
        return np.zeros(2)

    def approach(self, name: str, robot_state: Array, theta: Array, std: Array) -> Array | None:
        """The way (2,) m/s, round the box, to the nearer of the two faces that `name`, length or width, lies between.

        Then slowly against that face, as deep as half the force limit presses where it is expected; None there.
        """
        named, spread = self._named(theta), self._named(std)
        along = ("length", "width").index(name)
        place, half = robot_state[:2] - self._centre(named), 0.5 * _size(named)
        clear = half + _size(spread) + self.tip_radius + CLEARANCE
        outward = np.where(place >= 0.0, 1.0, -1.0)
        beyond = np.abs(place)
        way, across = np.zeros(2), 1 - along
        if beyond[across] < 0.8 * half[across]:  # it faces it
            deepest = half[along] + self.tip_radius - 0.5 * self.force_limit / self.stiffness
            if beyond[along] <= deepest:
                return None
            most = self.period * min(self.careful_speed, self.speed_limit)
            way[along] = -outward[along] * most
        elif beyond[along] >= clear[along]:
            way[across] = -place[across]
        elif beyond[across] >= clear[across] - CLEARANCE:
            way[along] = outward[along] * (clear[along] - beyond[along] + 0.5 * CLEARANCE)
        else:
            way[across] = outward[across] * (clear[across] - beyond[across])
        return np.clip(way / self.period, *self.velocity_bounds)

    def faces(self, motion: Array, forces: Array) -> list[str]:
        """The touched faces, of `FACES`, by the larger component of each of the forces (T, 2)."""
        touched = set()
        for force in forces[self.touching(forces)]:
            axis = int(np.argmax(np.abs(force)))
            touched.add(("+" if force[axis] > 0 else "-") + "xy"[axis])
        return [face for face in FACES if face in touched]

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        return {**PointModel.behaviour(self, motion, forces), "faces": self.faces(motion, forces)}


def _size(named: Mapping[str, Array]) -> Array:
    """Length and width (..., 2) m."""
    return np.stack([named["length"], named["width"]], axis=-1)


def _signed_distance(beyond: Array) -> Array:
    """Distance (...,) of a point to a rectangle from how far it is beyond each pair of sides (..., 2)."""
    first, second = beyond[..., 0], beyond[..., 1]
    corner = (first > 0) & (second > 0)
    square = np.where(corner, first * first + second * second, 1.0 + 0.0 * first)
    return np.asarray(np.where(corner, np.sqrt(square), np.maximum(first, second)))


def _gradient(beyond: Array) -> Array:
    """Gradient of `_signed_distance`, (..., 2)."""
    first, second = beyond[..., 0], beyond[..., 1]
    corner = (first > 0) & (second > 0)
    length = np.where(corner, _signed_distance(beyond), 1.0 + 0.0 * first)
    ahead = np.where(first >= second, 1.0, 0.0)
    return np.stack([np.where(corner, first / length, ahead), np.where(corner, second / length, 1.0 - ahead)], axis=-1)


def _outer(left: Array, right: Array) -> Array:
    """left rightᵀ over the last axis, (..., 2, 2)."""
    return np.asarray(left[..., :, np.newaxis] * right[..., np.newaxis, :])


def contouring(model: Contouring | None = None) -> Task:
    """The contouring task: one experiment of 4 s, estimated every fourth step, starting at (0.5, −0.1) m."""
    return Task(
        name="contouring",
        model=Contouring() if model is None else model,
        truth={"length": TRUE_LENGTH, "width": TRUE_WIDTH},
        robot_start=np.array([0.5, -0.1, 0.0, 0.0]),
        periods=80,
        experiments=1,
        estimate_every=4,
        law="kelvin_voigt",
    )
