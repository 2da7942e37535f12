"""Physics of arms that the vocabulary has no name for: the right verdict is `unexplained`, and where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .arm_context import ArmContext
from .laws import BodyLaw, Drive, JointLaw, Laws, Mode
from .noise import loguniform
from .robots import Array
from .truth import Concealed


def _size(rng: np.random.Generator) -> float:
    """Share of the joint's effort; an unknown must be visible to be called one."""
    return loguniform(rng, 0.08, 0.6)


def _joint(c: ArmContext, j: int) -> str:
    return c.robot.joints[j].name


def warming_viscosity(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """Viscous drag of a grease that warms: it decays with the work done in it, and stiffens with position."""
    coefficient, time = 3.0 * _size(rng) * c.effort(j) / c.speed(j), rng.uniform(1.0, 3.0)
    cycles = rng.uniform(3.0, 6.0)

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -coefficient * np.exp(-t / time) * (1.0 + 0.8 * np.sin(cycles * q)) * v

    told = {"coefficient": (coefficient, "N m s/rad"), "time": (time, "s"), "cycles": (cycles, "1/rad")}
    return Concealed("odd_warming_viscosity", _joint(c, j), told, Laws(joints=(JointLaw(j, torque),)))


def bouc_wen(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """Hysteresis of a soft gear that remembers tenths of a radian: z' = v - |v| z/reach, torque -T z|z|/reach^2."""
    torque_size, reach = 2.0 * _size(rng) * c.effort(j), max(0.3 * float(c.q[:, :, j].std()), 0.03)

    def rate(t: Array, q: Array, v: Array, u: Array, z: Array) -> Array:
        return (v - np.abs(v) * z[:, 0] / reach)[:, None]

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        part = z[:, 0] / reach
        return -torque_size * part * np.abs(part)

    told = {"torque": (torque_size, "N m"), "reach": (reach, "rad")}
    return Concealed("odd_bouc_wen_hysteresis", _joint(c, j), told, Laws(joints=(JointLaw(j, torque, 1, rate),)))


def oscillation(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A torque that swings in time, whatever the arm does: a fan, a neighbour's drive."""
    amplitude, frequency, phase = _size(rng) * c.effort(j), rng.uniform(1.5, 8.0), rng.uniform(0.0, 6.28)

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return amplitude * np.sin(2.0 * np.pi * frequency * t + phase + 2.0 * np.arange(len(t)))

    told = {"amplitude": (amplitude, "N m"), "frequency": (frequency, "Hz")}
    return Concealed("odd_torque_oscillation", _joint(c, j), told, Laws(joints=(JointLaw(j, torque),)))


def fading_drive(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A drive whose torque constant falls with the square of the effort and comes back slowly by itself: heat."""
    drop, time = 1.5 * _size(rng), rng.uniform(0.5, 1.5)
    level = c.effort(j) ** 2

    def rate(t: Array, q: Array, v: Array, u: Array, z: Array) -> Array:
        return ((u**2 / level - z[:, 0]) / time)[:, None]

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -drop * u * z[:, 0] / (1.0 + z[:, 0])

    told = {"drop": (drop, "1"), "time": (time, "s")}
    return Concealed("odd_fading_drive", _joint(c, j), told, Laws(joints=(JointLaw(j, torque, 1, rate),)))


def sloshing(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A pendulous load inside the last link that rocks on its own about the joint's axis."""
    joint = c.robot.size - 1
    frequency, strength = 2.0 * np.pi * rng.uniform(1.5, 5.0), _size(rng) * 1.5

    def rate(t: Array, q: Array, v: Array, u: Array, z: Array) -> Array:
        pull = frequency**2 * (q - z[:, 0]) + 0.1 * frequency * (v - z[:, 1])
        return np.column_stack([z[:, 1], pull])

    inertia = strength * c.effort(joint) / (frequency**2 * max(float(c.q[:, :, joint].std()), 0.05))

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        return -inertia * (frequency**2 * (q - z[:, 0]) + 0.1 * frequency * (v - z[:, 1]))

    told = {"inertia": (inertia, "kg m^2"), "frequency": (frequency / 6.2832, "Hz")}
    return Concealed("odd_sloshing_load", _joint(c, joint), told, Laws(joints=(JointLaw(joint, torque, 2, rate),)))


def speed_band(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """Chatter: a braking torque inside a band of speed only, and more the farther the joint is out."""
    speed, torque_size = c.speed(j) * rng.uniform(0.7, 1.3), 3.0 * _size(rng) * c.effort(j)
    centre = float(np.median(c.q[:, :, j]))
    reach = max(float(c.q[:, :, j].std()), 0.05)

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        band = np.exp(-(((np.abs(v) - speed) / (0.25 * speed)) ** 2))
        return -torque_size * np.sign(v) * band * (1.0 + np.tanh((q - centre) / reach))

    told = {"torque": (torque_size, "N m"), "speed": (speed, "rad/s")}
    return Concealed("odd_speed_band_brake", _joint(c, j), told, Laws(joints=(JointLaw(j, torque),)))


def negative_damping(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A drive that feeds energy in at low speed and takes it out at high speed (van der Pol), modulated in time."""
    coefficient = 2.0 * _size(rng) * c.effort(j) / c.speed(j)
    knee, frequency = c.speed(j) * rng.uniform(0.8, 1.2), rng.uniform(0.4, 1.0)

    def torque(t: Array, q: Array, v: Array, u: Array, z: Array, m: Mode) -> Array:
        wave = 1.0 + 0.7 * np.sin(2.0 * np.pi * frequency * t)
        return coefficient * wave * v * np.clip(1.0 - (v / knee) ** 2, -3.0, 1.0)

    told = {"coefficient": (coefficient, "N m s/rad"), "knee": (knee, "rad/s")}
    return Concealed("odd_negative_damping", _joint(c, j), told, Laws(joints=(JointLaw(j, torque),)))


def gusts(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """Wind that swings slowly in direction and size and pulls on a far link all the time."""
    link = c.robot.size - 1
    peak, frequency = loguniform(rng, 1.5, 20.0), rng.uniform(0.4, 1.4, 3)
    phase = rng.uniform(0.0, 6.28, 3)

    def force(t: Array, p: Array, rotation: Array, v: Array, omega: Array) -> tuple[Array, Array]:
        swing = np.sin(2.0 * np.pi * frequency * (t + 3.0 * np.arange(len(t)))[:, None] + phase)
        return peak * swing, p

    told = {"peak": (peak, "N")}
    law = BodyLaw(link, c.robot.links[link].com, force)
    return replace(Concealed("odd_gusts", c.robot.links[link].name, told, Laws(bodies=(law,))), place_kind="body")


def dropped_commands(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A drive that saturates softly and unequally on both sides, as no clip and no gain does."""
    knee = c.effort(j) * loguniform(rng, 0.4, 1.5)

    def static(u: Array) -> Array:
        return np.where(u > 0.0, knee * np.arctan(u / knee), u + 0.25 * knee * np.sin(2.0 * u / knee))

    return Concealed("odd_uneven_drive", _joint(c, j), {"knee": (knee, "N m")}, Laws(drives=(Drive(j, static=static),)))


Draw = Callable[[np.random.Generator, ArmContext, int], Concealed]
DRAWS: dict[str, Draw] = {
    "odd_warming_viscosity": warming_viscosity,
    "odd_bouc_wen_hysteresis": bouc_wen,
    "odd_torque_oscillation": oscillation,
    "odd_fading_drive": fading_drive,
    "odd_sloshing_load": sloshing,
    "odd_speed_band_brake": speed_band,
    "odd_negative_damping": negative_damping,
    "odd_gusts": gusts,
    "odd_uneven_drive": dropped_commands,
}


def draw(rng: np.random.Generator, context: ArmContext, name: str) -> Concealed:
    """The named oddity at a joint that moves."""
    return DRAWS[name](rng, context, int(rng.choice(context.moving())))
