"""The simulators' contact law with every contact effect, vectorised over recordings and contact points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .contact_kernel import LAW, NUMBERS, at_points
from .robots import Array


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
        at = (np.ascontiguousarray(x) for x in (time, point, velocity, z, touching))
        return at_points(*self._numbers, *at)  # type: ignore[no-any-return]

    @cached_property
    def _numbers(self) -> tuple[np.ndarray, Array]:
        """The law and its surface's axes as the compiled one reads them."""
        nan, numbers = float("nan"), dict(self.__dict__)
        numbers["static"] = nan if self.static is None else self.static
        numbers["first"], numbers["second"], numbers["angle"] = self.anisotropic or (nan, nan, nan)
        numbers["patch_part"], numbers["patch_rate"], numbers["patch_phase"] = self.patch or (0.0, 0.0, 0.0)
        law = np.array([tuple(numbers[name] for name in NUMBERS)], dtype=LAW)
        first = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        first /= np.linalg.norm(first)
        return law, np.stack([self.normal, first, np.cross(self.normal, first)])
