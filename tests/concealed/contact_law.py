"""The maker's contact law with every effect of the vocabulary, vectorised over recordings and contact points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .robots import Array
from .small import size_of

_RELEASE = 1e-3  # s, in which a bristle or a relaxing force is let go once out of contact


@dataclass(frozen=True)
class ContactLaw:
    """SI. Nominal: Kelvin-Voigt, -mu lambda tanh(|vt|/slip) along vt; zeros and Nones switch effects off."""

    stiffness: float
    damping: float
    friction: float
    slip_velocity: float
    static: float | None = None  # Stribeck
    stribeck_velocity: float = 0.05
    adhesion: float = 0.0  # N
    adhesion_range: float = 1e-3  # m
    cubic: float = 0.0  # N/m^3
    relaxing: float = 0.0  # N/m
    relaxation_time: float = 0.1  # s
    dissipation: float = 0.0  # s/m
    rolling: float = 0.0  # m
    anisotropic: tuple[float, float, float] | None = None  # mu along axis 1, along axis 2, angle of axis 1 from x
    presliding: float = 0.0  # m
    offset: float = 0.0  # m
    tilt: tuple[float, float] = (0.0, 0.0)  # rad
    patch: tuple[float, float, float] | None = None  # odd: friction changes over the surface (part, 1/m, phase)
    plastic: float = 0.0  # odd: share of the depth that stays behind
    ageing: float = 0.0  # odd: friction grows by this share per second of contact
    electric: float = 0.0  # odd: normal force that swings in time, N
    swelling: float = 0.0  # odd: m/s that the surface rises
    hysteresis: float = 0.0  # odd: share of the normal force lost while unloading

    hidden = 5  # per point: bristle x, y; relaxing force; time in contact; deepest depth

    @cached_property
    def normal(self) -> Array:
        """Unit normal of the true surface, world axes."""
        sx, sy = self.tilt
        n = np.array([-np.tan(sx), -np.tan(sy), 1.0])
        return np.asarray(n / np.linalg.norm(n))

    def depth(self, time: Array, point: Array) -> Array:
        """Penetration (B, K) of points (B, K, 3); the nominal surface is z = 0 through the origin."""
        return self.offset + self.swelling * time[:, None] - point @ self.normal

    def force(
        self, time: Array, point: Array, velocity: Array, z: Array, touching: np.ndarray
    ) -> tuple[Array, Array, Array, Array]:
        """Force (B, K, 3), pushing part lambda (B, K), rates of z (B, K, 5), depth (B, K).

        point, velocity: (B, K, 3) in world axes; touching (B, K) is the mode, so that a step never sees a jump.
        """
        n = self.normal
        d = self.depth(time, point)
        along = velocity @ n
        d_rate = self.swelling - along
        push = self.stiffness * d * (1.0 + self.dissipation * d_rate) + self.damping * d_rate + self.cubic * d**3
        if self.relaxing:
            push = push + z[:, :, 2]
        if self.plastic:
            push = push - self.stiffness * self.plastic * z[:, :, 4]
        if self.hysteresis:
            push = push * (1.0 + self.hysteresis * np.tanh(d_rate / 0.003))
        if self.electric:
            push = push + self.electric * np.sin(2.0 * np.pi * 3.3 * time[:, None]) ** 3
        pushing = np.where(touching, np.maximum(0.0, push), 0.0)
        net = pushing
        if self.adhesion:
            net = net - self.adhesion * np.where(d > 0.0, 1.0, np.exp(np.minimum(d, 0.0) / self.adhesion_range))
        tangential = velocity - along[:, :, None] * n
        speed = size_of(tangential)
        friction = self._friction(tangential, speed, point, z)
        force = net[:, :, None] * n - pushing[:, :, None] * friction
        return force, pushing, self._rates(tangential, speed, d, d_rate, z, touching), d

    def _friction(self, tangential: Array, speed: Array, point: Array, z: Array) -> Array:
        """What lambda is multiplied by, along the motion: (B, K, 3)."""
        if self.presliding:
            bristle = self.friction / self.presliding * z[:, :, :2]
            return self._in_plane(bristle)
        mu: Array | float = self.friction
        if self.static is not None:
            mu = mu + (self.static - self.friction) * np.exp(-((speed / self.stribeck_velocity) ** 2))
        if self.patch is not None:
            part, per_metre, phase = self.patch
            mu = mu * (
                1.0 + part * np.sin(per_metre * point[:, :, 0] + phase) * np.sin(per_metre * point[:, :, 1] - phase)
            )
        if self.ageing:
            mu = mu * (1.0 + self.ageing * z[:, :, 3])
        # tanh(s/w)/s is finite at rest.
        ratio = speed / self.slip_velocity
        factor = np.where(ratio > 1e-6, np.tanh(ratio) / np.maximum(speed, 1e-300), 1.0 / self.slip_velocity)
        if self.anisotropic is not None:
            mu_1, mu_2, angle = self.anisotropic
            axis = np.array([np.cos(angle), np.sin(angle)])
            other = np.array([-axis[1], axis[0]])
            plane = self._components(tangential)
            both = mu_1 * (plane @ axis)[:, :, None] * axis + mu_2 * (plane @ other)[:, :, None] * other
            return factor[:, :, None] * self._in_plane(both)
        return (mu * factor)[:, :, None] * tangential

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        n = self.normal
        first = np.array([1.0, 0.0, 0.0]) - n[0] * n
        first /= np.linalg.norm(first)
        return first, np.cross(n, first)

    def _components(self, tangential: Array) -> Array:
        first, second = self._axes
        return np.stack([tangential @ first, tangential @ second], axis=2)

    def _in_plane(self, components: Array) -> Array:
        first, second = self._axes
        return components[:, :, :1] * first + components[:, :, 1:] * second

    def _rates(self, tangential: Array, speed: Array, d: Array, d_rate: Array, z: Array, touching: np.ndarray) -> Array:
        rates = np.where(touching[:, :, None], 0.0, -z / _RELEASE)
        if self.presliding:
            slide = self._components(tangential) - speed[:, :, None] * z[:, :, :2] / self.presliding
            rates[:, :, :2] = np.where(touching[:, :, None], slide, rates[:, :, :2])
        if self.relaxing:
            relax = self.relaxing * d_rate - z[:, :, 2] / self.relaxation_time
            rates[:, :, 2] = np.where(touching, relax, rates[:, :, 2])
        if self.ageing:
            rates[:, :, 3] = np.where(touching, 1.0, rates[:, :, 3])
        if self.plastic:
            # The deepest depth so far, followed within a few milliseconds, forgotten within a second.
            rates[:, :, 4] = np.where(
                touching, np.maximum(0.0, d - z[:, :, 4]) / 3e-3 - z[:, :, 4] / 0.8, -z[:, :, 4] / 0.8
            )
        return rates
