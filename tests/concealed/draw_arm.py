"""Random effects on arms: kind, place and strength, from invisible to glaring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from . import laws, timing
from .mujoco_arm import ArmInverse
from .noise import loguniform
from .robots import Array, Robot
from .truth import Concealed


@dataclass(frozen=True)
class ArmContext:
    """What a strength is scaled by: the desired motion and its efforts (B, N, n)."""

    robot: Robot
    q: Array
    v: Array
    u: Array
    duration: float
    has_velocity: bool
    recordings: tuple[str, ...]

    def effort(self, joint: int) -> float:
        """Typical effort of a joint that moves: its rms, or a share of the largest joint's where it hardly works."""
        rms = np.sqrt(np.mean(self.u**2, axis=(0, 1)))
        return float(max(rms[joint], 0.05 * rms.max()))

    def speed(self, joint: int) -> float:
        return float(max(np.sqrt(np.mean(self.v[:, :, joint] ** 2)), 0.02))

    def moving(self) -> list[int]:
        """Joints that move: nothing can be learnt of the friction of a joint at rest."""
        rms = np.sqrt(np.mean(self.v**2, axis=(0, 1)))
        return [int(joint) for joint in np.flatnonzero(rms > 0.1 * rms.max())]

    def unit(self, joint: int, rotary: str) -> str:
        if self.robot.joints[joint].kind == "revolute":
            return rotary
        return {
            "N m": "N",
            "N m s/rad": "N s/m",
            "N m/rad": "N/m",
            "rad": "m",
            "rad/s": "m/s",
            "kg m^2": "kg",
            "1/rad": "1/m",
        }[rotary]


Draw = Callable[[np.random.Generator, ArmContext, int], Concealed]


def _share(rng: np.random.Generator) -> float:
    return loguniform(rng, 0.002, 0.5)


def _joint(context: ArmContext, joint: int) -> str:
    return context.robot.joints[joint].name


def _width(rng: np.random.Generator) -> tuple[float, bool, str]:
    """Smoothing width of a concealed friction: mostly 0.005, else one that a diagnosis does not expect."""
    pick = rng.random()
    if pick < 0.75:
        return 0.005, True, ""
    return (
        (float(rng.uniform(0.001, 0.003)), False, "narrow")
        if pick < 0.88
        else (float(rng.uniform(0.01, 0.03)), False, "wide")
    )


def _viscous(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    coefficient = _share(rng) * c.effort(j) / c.speed(j)
    return Concealed(
        "joint_viscous_friction",
        _joint(c, j),
        {"coefficient": (coefficient, c.unit(j, "N m s/rad"))},
        laws.viscous(j, coefficient),
    )


def _coulomb(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    torque = _share(rng) * c.effort(j)
    told = {"torque": (torque, c.unit(j, "N m"))}
    if rng.random() < 0.15:
        # A bristle that deflects by 1e-3 of a radian before it slides.
        bristle = torque / loguniform(rng, 3e-4, 2e-3)
        law = laws.lugre(j, torque, torque * rng.uniform(1.0, 1.15), 0.02, bristle, 2.0 * np.sqrt(bristle) * 0.02)
        return Concealed("joint_coulomb_friction", _joint(c, j), told, law, exact=False, variant="lugre")
    width, exact, variant = _width(rng)
    return Concealed(
        "joint_coulomb_friction", _joint(c, j), told, laws.coulomb(j, torque, width), exact=exact, variant=variant
    )


def _asymmetric(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    positive = _share(rng) * c.effort(j)
    negative = positive * (rng.uniform(0.15, 0.6) if rng.random() < 0.5 else rng.uniform(1.7, 4.0))
    unit = c.unit(j, "N m")
    return Concealed(
        "joint_asymmetric_coulomb_friction",
        _joint(c, j),
        {"torque_positive": (positive, unit), "torque_negative": (negative, unit)},
        laws.asymmetric_coulomb(j, positive, negative),
    )


def _stribeck(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    kinetic = _share(rng) * c.effort(j)
    static, velocity = kinetic * rng.uniform(1.4, 3.0), c.speed(j) * rng.uniform(0.08, 0.4)
    told = {
        "coulomb": (kinetic, c.unit(j, "N m")),
        "static": (static, c.unit(j, "N m")),
        "velocity": (velocity, c.unit(j, "rad/s")),
    }
    if rng.random() < 0.15:
        bristle = kinetic / loguniform(rng, 2e-4, 1e-3)
        law = laws.lugre(j, kinetic, static, velocity, bristle, 0.04 * np.sqrt(bristle))
        return Concealed("joint_stribeck_friction", _joint(c, j), told, law, exact=False, variant="lugre")
    width, exact, variant = _width(rng)
    law = laws.stribeck(j, kinetic, static, velocity, width)
    return Concealed("joint_stribeck_friction", _joint(c, j), told, law, exact=exact, variant=variant)


def _load(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    coefficient = loguniform(rng, 0.005, 0.35)
    torque = c.effort(j) * coefficient * rng.uniform(0.1, 1.0)
    return Concealed(
        "joint_load_dependent_friction",
        _joint(c, j),
        {"torque": (torque, c.unit(j, "N m")), "coefficient": (coefficient, "1")},
        laws.load_dependent(j, torque, coefficient),
    )


def _spring(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    q = c.q[:, :, j]
    stiffness = _share(rng) * c.effort(j) / max(float(q.std()), 0.05)
    rest = float(rng.uniform(q.min(), q.max()))
    return Concealed(
        "joint_spring",
        _joint(c, j),
        {"stiffness": (stiffness, c.unit(j, "N m/rad")), "rest": (rest, c.unit(j, "rad"))},
        laws.spring(j, stiffness, rest),
    )


def _backlash(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    inertia = c.robot.joints[j].rotor_inertia
    gap = loguniform(rng, 2e-4, 2e-2) * (0.2 if c.robot.joints[j].kind == "prismatic" else 1.0)
    stiffness = inertia * (2.0 * np.pi * rng.uniform(15.0, 40.0)) ** 2
    damping = 2.0 * rng.uniform(0.15, 0.5) * np.sqrt(stiffness * inertia)
    return Concealed(
        "joint_backlash",
        _joint(c, j),
        {
            "gap": (gap, c.unit(j, "rad")),
            "stiffness": (stiffness, c.unit(j, "N m/rad")),
            "damping": (damping, c.unit(j, "N m s/rad")),
        },
        laws.backlash(j, gap, stiffness, damping),
    )


def _hard_stop(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    side = float(rng.choice([-1.0, 1.0]))
    reach = side * c.q[:, :, j]
    position = side * float(np.quantile(reach, rng.uniform(0.75, 0.95)))
    depth = max(float(reach.max()) - side * position, 0.01)
    stiffness = loguniform(rng, 0.02, 5.0) * c.effort(j) / depth
    inertia = _inertia(c, j)
    damping = 2.0 * rng.uniform(0.0, 0.3) * np.sqrt(stiffness * inertia)
    return Concealed(
        "joint_hard_stop",
        _joint(c, j),
        {
            "position": (position, c.unit(j, "rad")),
            "stiffness": (stiffness, c.unit(j, "N m/rad")),
            "side": (side, "1"),
            "damping": (damping, c.unit(j, "N m s/rad")),
        },
        laws.hard_stop(j, position, stiffness, side, damping),
    )


def _inertia(c: ArmContext, j: int) -> float:
    return float(ArmInverse(c.robot).mass_matrix(c.q[0, 0])[j, j])


def _elasticity(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    rotor = c.robot.joints[j].rotor_inertia
    link = max(_inertia(c, j) - rotor, 1e-3)
    reduced = rotor * link / (rotor + link)
    stiffness = reduced * (2.0 * np.pi * loguniform(rng, 5.0, 60.0)) ** 2
    damping = 2.0 * loguniform(rng, 0.02, 0.3) * np.sqrt(stiffness * reduced)
    return Concealed(
        "joint_elasticity",
        _joint(c, j),
        {"stiffness": (stiffness, c.unit(j, "N m/rad")), "damping": (damping, c.unit(j, "N m s/rad"))},
        laws.elasticity(j, stiffness, damping),
    )


def _rotor(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    extra = loguniform(rng, 0.003, 0.5) * _inertia(c, j)
    return Concealed(
        "rotor_inertia",
        _joint(c, j),
        {"inertia": (extra, c.unit(j, "kg m^2"))},
        change=lambda robot: robot.replace_joint(j, rotor_inertia=robot.joints[j].rotor_inertia + extra),
    )


def _ripple(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    amplitude = _share(rng) * c.effort(j)
    span = max(float(np.ptp(c.q[:, :, j])), 0.05)
    cycles = float(rng.uniform(2.0, 12.0) * 2.0 * np.pi / span)
    phase = float(rng.uniform(-np.pi, np.pi))
    return Concealed(
        "torque_ripple",
        _joint(c, j),
        {"amplitude": (amplitude, c.unit(j, "N m")), "cycles": (cycles, c.unit(j, "1/rad")), "phase": (phase, "rad")},
        laws.ripple(j, amplitude, cycles, phase),
    )


def _delay(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    seconds = loguniform(rng, 3e-4, 2e-2)
    return Concealed("actuator_delay", _joint(c, j), {"delay": (seconds, "s")}, laws.delay(j, seconds))


def _lag(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    seconds = loguniform(rng, 3e-4, 2e-2)
    return Concealed("actuator_lag", _joint(c, j), {"time_constant": (seconds, "s")}, laws.lag(j, seconds))


def _saturation(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    limit = float(np.quantile(np.abs(c.u[:, :, j]), rng.uniform(0.6, 0.985)))
    return Concealed(
        "actuator_saturation", _joint(c, j), {"limit": (limit, c.unit(j, "N m"))}, laws.saturation(j, limit)
    )


def _gain(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    gain = 1.0 + float(rng.choice([-1.0, 1.0])) * loguniform(rng, 0.004, 0.3)
    return Concealed("actuator_gain_error", _joint(c, j), {"gain": (gain, "1")}, laws.gain_error(j, gain))


def _bias(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    torque = float(rng.choice([-1.0, 1.0])) * _share(rng) * c.effort(j)
    return Concealed("actuator_bias", _joint(c, j), {"torque": (torque, c.unit(j, "N m"))}, laws.bias(j, torque))


def _dead_zone(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    width = _share(rng) * c.effort(j)
    return Concealed("actuator_dead_zone", _joint(c, j), {"width": (width, c.unit(j, "N m"))}, laws.dead_zone(j, width))


def _carried(rng: np.random.Generator, c: ArmContext) -> int:
    """A link that moves, more often one far out."""
    first = min(c.moving())
    links = c.robot.descendants(first)
    weights = np.arange(1.0, len(links) + 1.0)
    return int(rng.choice(links, p=weights / weights.sum()))


def _payload(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    link = _carried(rng, c)
    body = c.robot.links[link]
    mass = loguniform(rng, 0.004, 0.5) * body.mass
    p = body.com + rng.normal(0.0, 0.07, 3)
    told = {"mass": (mass, "kg")} | {name: (float(value), "m") for name, value in zip("xyz", p, strict=True)}
    return Concealed(
        "payload",
        body.name,
        told,
        change=lambda robot: robot.replace_link(link, robot.links[link].with_point_mass(mass, p)),
        place_kind="body",
    )


def misaligned_gravity(rng: np.random.Generator) -> tuple[Concealed, Array]:
    size, angle = loguniform(rng, 1e-3, 0.15), rng.uniform(0.0, 2.0 * np.pi)
    roll, pitch = float(size * np.cos(angle)), float(size * np.sin(angle))
    gravity = (
        Rotation.from_euler("x", roll).as_matrix() @ Rotation.from_euler("y", pitch).as_matrix() @ [0.0, 0.0, -9.81]
    )

    def change(robot: Robot) -> Robot:
        return Robot(robot.name, robot.links, robot.joints, gravity)

    told = {"roll": (roll, "rad"), "pitch": (pitch, "rad")}
    return Concealed("gravity_misalignment", "world", told, change=change, place_kind="environment"), gravity


def _gravity(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    return misaligned_gravity(rng)[0]


def _drag(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    link = _carried(rng, c)
    coefficient = loguniform(rng, 0.02, 8.0)
    body = c.robot.links[link]
    return Concealed(
        "aerodynamic_drag",
        body.name,
        {"coefficient": (coefficient, "N s^2/m^2")},
        laws.drag(link, body.com, coefficient),
        place_kind="body",
    )


def _disturbance(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    links = list(range(1, c.robot.size)) or [0]
    link = int(rng.choice(links))
    direction = rng.normal(size=3)
    peak = loguniform(rng, 0.3, 60.0) * direction / np.linalg.norm(direction)
    width = loguniform(rng, 0.08, 0.5)
    first = float(rng.uniform(0.3, c.duration - width - 0.3))
    member = int(rng.integers(3))
    interval = (first, first + width)
    told = {name: (float(value), "N") for name, value in zip("xyz", peak, strict=True)}
    return Concealed(
        "external_disturbance",
        c.robot.links[link].name,
        told,
        laws.disturbance(link, peak, interval, member),
        interval=interval,
        recording=c.recordings[member],
        place_kind="body",
    )


def _unmodeled(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A plane across the path of a far link's origin, touched for a few percent of the time."""
    links = list(range(max(1, c.robot.size // 2), c.robot.size))
    link = int(rng.choice(links))
    normal = rng.normal(size=3) + np.array([0.0, 0.0, 0.8])
    normal /= np.linalg.norm(normal)
    path = ArmInverse(c.robot).point(c.q[:, ::10].reshape(-1, c.robot.size), link, np.zeros(3)) @ normal
    offset = float(np.quantile(path, rng.uniform(0.03, 0.2)))
    depth = max(offset - float(path.min()), 2e-3)
    stiffness = loguniform(rng, 0.2, 40.0) / depth
    damping = stiffness * rng.uniform(0.0, 0.02)
    told = {"offset": (offset, "m"), "stiffness": (stiffness, "N/m"), "damping": (damping, "N s/m")}
    told |= {name: (float(value), "1") for name, value in zip(("nx", "ny", "nz"), normal, strict=True)}
    return Concealed(
        "unmodeled_contact",
        c.robot.links[link].name,
        told,
        laws.unmodeled_contact(link, np.zeros(3), normal, offset, stiffness, damping),
        place_kind="body",
    )


def _channel(rng: np.random.Generator, c: ArmContext, j: int) -> tuple[str, bool]:
    velocity = bool(c.has_velocity and rng.random() < 0.35)
    return f"{'v' if velocity else 'q'}.{_joint(c, j)}", velocity


def _sensor(effect: str) -> Draw:
    def draw(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
        channel, velocity = _channel(rng, c, j)
        linear = 0.2 if c.robot.joints[j].kind == "prismatic" else 1.0
        sign = float(rng.choice([-1.0, 1.0]))
        unit = c.unit(j, "rad/s" if velocity else "rad")
        if effect == "sensor_bias":
            amount = sign * linear * loguniform(rng, 1e-3, 0.15)
            return Concealed(effect, channel, {"bias": (amount, unit)}, sensor=timing.biased([channel], amount))
        if effect == "sensor_gain_error":
            gain = 1.0 + sign * loguniform(rng, 2e-3, 0.15)
            return Concealed(effect, channel, {"gain": (gain, "1")}, sensor=timing.scaled([channel], gain))
        if effect == "sensor_drift":
            rate = sign * linear * loguniform(rng, 2e-4, 2e-2)
            return Concealed(effect, channel, {"rate": (rate, unit + "/s")}, sensor=timing.drifting([channel], rate))
        if effect == "clock_skew":
            skew = sign * loguniform(rng, 1e-4, 5e-3)
            return Concealed(effect, channel, {"skew": (skew, "1")}, sensor=timing.skewed([channel], skew))
        seconds = loguniform(rng, 5e-4, 2e-2)
        if effect == "sensor_delay":
            return Concealed(effect, channel, {"delay": (seconds, "s")}, sensor=timing.delayed([channel], seconds))
        return Concealed(effect, channel, {"time_constant": (seconds, "s")}, sensor=timing.lagged([channel], seconds))

    return draw


DRAWS: dict[str, Draw] = {
    "joint_viscous_friction": _viscous,
    "joint_coulomb_friction": _coulomb,
    "joint_asymmetric_coulomb_friction": _asymmetric,
    "joint_stribeck_friction": _stribeck,
    "joint_load_dependent_friction": _load,
    "joint_spring": _spring,
    "joint_backlash": _backlash,
    "joint_hard_stop": _hard_stop,
    "joint_elasticity": _elasticity,
    "rotor_inertia": _rotor,
    "torque_ripple": _ripple,
    "actuator_delay": _delay,
    "actuator_lag": _lag,
    "actuator_saturation": _saturation,
    "actuator_gain_error": _gain,
    "actuator_bias": _bias,
    "actuator_dead_zone": _dead_zone,
    "payload": _payload,
    "gravity_misalignment": _gravity,
    "aerodynamic_drag": _drag,
    "external_disturbance": _disturbance,
    "unmodeled_contact": _unmodeled,
    **{
        name: _sensor(name)
        for name in ("sensor_bias", "sensor_gain_error", "sensor_drift", "sensor_delay", "sensor_lag", "clock_skew")
    },
}


def draw_arm(
    rng: np.random.Generator, context: ArmContext, effect: str, avoid: frozenset[int] = frozenset()
) -> tuple[Concealed, int]:
    """The effect at a random joint that moves, and that joint."""
    joints = [joint for joint in context.moving() if joint not in avoid] or context.moving()
    joint = int(rng.choice(joints))
    return DRAWS[effect](rng, context, joint), joint
