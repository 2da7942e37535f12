"""A thrown sphere or box that lands on flat ground: rigid body dynamics with contact at points, in world axes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .contact_law import ContactLaw
from .integrate import Integrator
from .robots import Array, Link
from .small import cross, quaternion_rate, size_of, turn_of

_ROLLING_WIDTH = 0.05  # rad/s, smoothing of rolling resistance's direction

# (t, p of the body's origin, v of it) -> force (B, 3) at the origin; (t, v of the centre of mass) -> force there
OriginForce = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class Shape:
    """A sphere (radius) or a box (full extents), centred at the body's origin; m."""

    radius: float = 0.0
    extents: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def corners(self) -> Array:
        """(K, 3) body-frame contact points of a box."""
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        return np.asarray(0.5 * signs * np.array(self.extents))

    @property
    def points(self) -> int:
        return 1 if self.radius else 8


@dataclass(frozen=True)
class Toss:
    """The thrown body and its world; `link` holds mass, centre of mass and inertia."""

    link: Link
    shape: Shape
    law: ContactLaw
    gravity: Array
    drag: float = 0.0  # N s^2/m^2
    at_origin: OriginForce | None = None
    magnus: float = 0.0  # odd: lift per spin and speed, kg
    lag_mass: float = 0.0  # odd: share of the mass that sloshes
    copies: int = 4

    @property
    def columns(self) -> int:
        return 13 + ContactLaw.hidden * self.shape.points

    def contact_points(self, centre: Array, rotation: Array) -> Array:
        """World points (B, K, 3) that may touch; `centre` is the body's origin."""
        if self.shape.radius:
            return (centre - self.shape.radius * self.law.normal)[:, None, :]
        return centre[:, None, :] + self.shape.corners @ rotation.swapaxes(1, 2)

    def _read(self, x: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Rotation, its lever to the centre of mass, origin, velocities of the centre of mass, spin."""
        rotation = rotation_matrix(x[:, 3:7])
        lever = rotation @ self.link.com
        return rotation, lever, x[:, :3] - lever, x[:, 7:10], x[:, 10:13]

    def boundary(self, t: Array, x: Array) -> Array:
        rotation, _, origin, _, _ = self._read(x)
        return self.law.depth(t, self.contact_points(origin, rotation))

    def derivative(self, t: Array, x: Array, mode: np.ndarray) -> Array:
        """Rates of (p_com, quaternion, v_com, omega, hidden)."""
        rotation, lever, origin, v, omega = self._read(x)
        points = self.contact_points(origin, rotation)
        arms = points - x[:, None, :3]
        speeds = v[:, None, :] + cross(omega[:, None, :], arms)
        z = x[:, 13:].reshape(len(x), -1, ContactLaw.hidden)
        force, pushing, rates, _ = self.law.force(t, points, speeds, z, mode)
        total = force.sum(axis=1)
        torque = cross(arms, force).sum(axis=1)
        if self.law.rolling:
            torque -= self._rolling(omega, pushing.sum(axis=1))
        total = total + self.link.mass * self.gravity - self.drag * size_of(v)[:, None] * v
        if self.magnus:
            total = total + self.magnus * cross(omega, v)
        if self.at_origin is not None:
            extra = self.at_origin(t, origin, v)
            total, torque = total + extra, torque + cross(-lever, extra)
        own = (omega[:, None, :] @ rotation) @ self.link.inertia
        spin = (rotation @ own.swapaxes(1, 2))[:, :, 0]
        out = np.empty_like(x)
        out[:, :3] = v
        out[:, 3:7] = quaternion_rate(x[:, 3:7], omega)
        out[:, 7:10] = total / self.link.mass
        out[:, 10:13] = self._turned_by(torque - cross(omega, spin), rotation)
        out[:, 13:] = rates.reshape(len(x), -1)
        return out

    def _turned_by(self, torque: Array, rotation: Array) -> Array:
        """Rate of the spin (B, 3)."""
        own = (torque[:, None, :] @ rotation) @ self._ease
        return np.asarray((rotation @ own.swapaxes(1, 2))[:, :, 0])

    @cached_property
    def _ease(self) -> Array:
        """Inverse of the inertia about the centre of mass, body axes (3, 3)."""
        return np.linalg.inv(self.link.inertia)

    def _rolling(self, omega: Array, pushing: Array) -> Array:
        n = self.law.normal
        tangential = omega - (omega @ n)[:, None] * n
        size = size_of(tangential)
        factor = np.tanh(size / _ROLLING_WIDTH) / np.maximum(size, 1e-9)
        return (self.law.rolling * pushing * factor)[:, None] * tangential

    def run(self, time: Array, start: Array, tolerance: float = 1e-7) -> Array:
        """States (B, N, 13 + hidden) at time (B, N) from start (B, 13)."""
        x = np.zeros((len(start), self.columns))
        x[:, :13] = start
        integrator = Integrator(self.derivative, self.boundary, tolerance)
        mode = integrator.initial_mode(time[:, 0], x)
        record = np.empty((time.shape[1], *x.shape))
        record[0] = x
        for k in range(time.shape[1] - 1):
            x, mode = integrator.advance(time[:, k], time[:, k + 1], x, mode)
            x[:, 3:7] /= np.linalg.norm(x[:, 3:7], axis=1, keepdims=True)
            record[k + 1] = x
        return record.swapaxes(0, 1)

    def origin(self, states: Array) -> Array:
        """Body's origin (B, N, 3) of states (B, N, ...)."""
        flat = states.reshape(-1, states.shape[-1])
        return (flat[:, :3] - rotation_matrix(flat[:, 3:7]) @ self.link.com).reshape(*states.shape[:2], 3)


def rotation_matrix(quaternion: Array) -> Array:
    """(B, 3, 3) of (w, x, y, z), normalised."""
    return turn_of(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
