"""The simulated laws of joints, transmissions, actuators and bodies, as the vocabulary states them.

Arrays run over the batch of recordings: t, q, v, u and tau have shape (B,). A law with hidden states has z (B, h).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .robots import Array

Mode = np.ndarray  # (B,) bool
Scalar = Callable[..., Array]


@dataclass(frozen=True)
class JointLaw:
    """A torque (N m) on the link side of a joint: torque(t, q, v, u, z, mode); rate(t, q, v, u, z) of hidden states."""

    joint: int
    torque: Scalar
    states: int = 0
    rate: Scalar | None = None
    boundary: Scalar | None = None  # (t, q, v) -> (B,), positive where `mode` holds


@dataclass(frozen=True)
class Transmission:
    """Rotor and link coupled: torque(twist, twist_rate, mode (B, 2)) acts on the link; boundary(twist) -> (B, 2)."""

    joint: int
    torque: Scalar
    boundary: Scalar | None = None


@dataclass(frozen=True)
class Drive:
    """Between the commanded and the acting effort of a joint: delay, then first-order lag, then a static map."""

    joint: int
    delay: float = 0.0
    time_constant: float = 0.0
    static: Scalar | None = None


@dataclass(frozen=True)
class BodyLaw:
    """A force on a link: force(t, p, R, v, omega) -> (force (B, 3), point (B, 3)) in world axes.

    p, v are the position and velocity of `point_of_body` (body frame). `boundary(t, p)` -> (B,) marks a touching mode.
    """

    link: int
    point_of_body: Array
    force: Scalar
    boundary: Scalar | None = None


@dataclass(frozen=True)
class Laws:
    """Everything beyond the nominal plant that acts in a simulation."""

    joints: tuple[JointLaw, ...] = ()
    transmissions: tuple[Transmission, ...] = ()
    drives: tuple[Drive, ...] = ()
    bodies: tuple[BodyLaw, ...] = ()
    labels: tuple[str, ...] = field(default=())

    def __add__(self, other: Laws) -> Laws:
        return Laws(
            self.joints + other.joints,
            self.transmissions + other.transmissions,
            self.drives + other.drives,
            self.bodies + other.bodies,
            self.labels + other.labels,
        )


def viscous(joint: int, coefficient: float) -> Laws:
    return Laws(joints=(JointLaw(joint, lambda t, q, v, u, z, m: -coefficient * v),))


def coulomb(joint: int, torque: float, width: float = 0.005) -> Laws:
    return Laws(joints=(JointLaw(joint, lambda t, q, v, u, z, m: -torque * np.tanh(v / width)),))


def asymmetric_coulomb(joint: int, positive: float, negative: float, width: float = 0.005) -> Laws:
    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -np.where(v > 0.0, positive, negative) * np.tanh(v / width)

    return Laws(joints=(JointLaw(joint, torque),))


def stribeck(joint: int, kinetic: float, static: float, velocity: float, width: float = 0.005) -> Laws:
    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -(kinetic + (static - kinetic) * np.exp(-((v / velocity) ** 2))) * np.tanh(v / width)

    return Laws(joints=(JointLaw(joint, torque),))


def load_dependent(joint: int, torque: float, coefficient: float, width: float = 0.005) -> Laws:
    def law(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -(torque + coefficient * np.abs(u)) * np.tanh(v / width)

    return Laws(joints=(JointLaw(joint, law),))


def spring(joint: int, stiffness: float, rest: float) -> Laws:
    return Laws(joints=(JointLaw(joint, lambda t, q, v, u, z, m: -stiffness * (q - rest)),))


def ripple(joint: int, amplitude: float, cycles: float, phase: float) -> Laws:
    return Laws(joints=(JointLaw(joint, lambda t, q, v, u, z, m: amplitude * np.sin(cycles * q + phase)),))


def hard_stop(joint: int, position: float, stiffness: float, side: float, damping: float) -> Laws:
    """A one-sided spring and damper that never pulls."""

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        push = stiffness * side * (q - position) + damping * side * v
        return -side * np.where(m, np.maximum(0.0, push), 0.0)

    return Laws(joints=(JointLaw(joint, torque, boundary=lambda t, q, v: side * (q - position)),))


def lugre(joint: int, kinetic: float, static: float, velocity: float, bristle: float, damping: float) -> Laws:
    """LuGre friction: z' = v - bristle |v| z / g(v), torque -(bristle z + damping z'), g the Stribeck curve."""

    def level(v: Array) -> Array:
        return kinetic + (static - kinetic) * np.exp(-((v / velocity) ** 2))

    def rate(t: Array, q: Array, v: Array, u: Array, z: Array) -> Array:
        return (v - bristle * np.abs(v) * z[:, 0] / level(v))[:, None]

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -(bristle * z[:, 0] + damping * rate(t, q, v, u, z)[:, 0])

    return Laws(joints=(JointLaw(joint, torque, 1, rate),))


def elasticity(joint: int, stiffness: float, damping: float) -> Laws:
    """A spring and damper between rotor and link."""
    return Laws(transmissions=(Transmission(joint, lambda twist, rate, m: stiffness * twist + damping * rate),))


def backlash(joint: int, gap: float, stiffness: float, damping: float) -> Laws:
    """Rotor and link push each other on either flank of a gap of `gap` in all; flanks do not pull."""

    def torque(twist: Array, rate: Array, mode: Mode) -> Array:
        forward = np.maximum(0.0, stiffness * (twist - 0.5 * gap) + damping * rate)
        backward = np.maximum(0.0, stiffness * (-twist - 0.5 * gap) - damping * rate)
        return np.where(mode[:, 0], forward, 0.0) - np.where(mode[:, 1], backward, 0.0)

    def boundary(twist: Array) -> Array:
        return np.column_stack([twist - 0.5 * gap, -twist - 0.5 * gap])

    return Laws(transmissions=(Transmission(joint, torque, boundary),))


def delay(joint: int, seconds: float) -> Laws:
    return Laws(drives=(Drive(joint, delay=seconds),))


def lag(joint: int, time_constant: float) -> Laws:
    return Laws(drives=(Drive(joint, time_constant=time_constant),))


def saturation(joint: int, limit: float) -> Laws:
    return Laws(drives=(Drive(joint, static=lambda u: np.clip(u, -limit, limit)),))


def gain_error(joint: int, gain: float) -> Laws:
    return Laws(drives=(Drive(joint, static=lambda u: gain * u),))


def bias(joint: int, torque: float) -> Laws:
    return Laws(drives=(Drive(joint, static=lambda u: u + torque),))


def dead_zone(joint: int, width: float) -> Laws:
    return Laws(drives=(Drive(joint, static=lambda u: np.sign(u) * np.maximum(0.0, np.abs(u) - width)),))


def drag(link: int, com: Array, coefficient: float) -> Laws:
    """-c |v| v at the nominal centre of mass."""

    def force(t: Array, p: Array, rotation: Array, v: Array, omega: Array) -> tuple[Array, Array]:
        return -coefficient * np.linalg.norm(v, axis=1, keepdims=True) * v, p

    return Laws(bodies=(BodyLaw(link, com, force),))


def disturbance(link: int, peak: Array, interval: tuple[float, float], member: int) -> Laws:
    """A sin^2 pulse of force (world axes) at the body's origin, in one member of the batch."""

    def force(t: Array, p: Array, rotation: Array, v: Array, omega: Array) -> tuple[Array, Array]:
        return pulse(t, interval, member)[:, None] * peak, p

    return Laws(bodies=(BodyLaw(link, np.zeros(3), force),))


def pulse(t: Array, interval: tuple[float, float], member: int) -> Array:
    """sin^2 over the interval for the member, zero elsewhere; shape (B,)."""
    first, last = interval
    inside = (t > first) & (t < last) & (np.arange(len(t)) == member)
    return np.where(inside, np.sin(np.pi * (t - first) / (last - first)) ** 2, 0.0)


def unmodeled_contact(link: int, point: Array, normal: Array, offset: float, stiffness: float, damping: float) -> Laws:
    """A frictionless plane normal . p = offset (world) that a point of the body touches from above."""

    def force(t: Array, p: Array, rotation: Array, v: Array, omega: Array) -> tuple[Array, Array]:
        depth = offset - p @ normal
        push = np.where(depth > 0.0, np.maximum(0.0, stiffness * depth - damping * (v @ normal)), 0.0)
        return push[:, None] * normal, p

    return Laws(bodies=(BodyLaw(link, point, force, boundary=lambda t, p: offset - p @ normal),))
