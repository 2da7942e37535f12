"""Random effects of joints and actuators on arms: kind, place and strength, from undetectable to obvious."""

from __future__ import annotations

import numpy as np

from . import draw_link, laws
from .arm_context import ArmContext, Draw
from .mujoco_arm import ArmInverse
from .noise import loguniform
from .truth import Concealed


def _share(rng: np.random.Generator) -> float:
    return loguniform(rng, 0.004, 0.7)


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
    gap = loguniform(rng, 5e-4, 3e-2) * (0.2 if c.robot.joints[j].kind == "prismatic" else 1.0)
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
    extra = loguniform(rng, 0.01, 0.8) * _inertia(c, j)
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
    seconds = loguniform(rng, 5e-4, 2.5e-2)
    return Concealed("actuator_delay", _joint(c, j), {"delay": (seconds, "s")}, laws.delay(j, seconds))


def _lag(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    seconds = loguniform(rng, 5e-4, 2.5e-2)
    return Concealed("actuator_lag", _joint(c, j), {"time_constant": (seconds, "s")}, laws.lag(j, seconds))


def _saturation(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    limit = float(np.quantile(np.abs(c.u[:, :, j]), rng.uniform(0.6, 0.985)))
    return Concealed(
        "actuator_saturation", _joint(c, j), {"limit": (limit, c.unit(j, "N m"))}, laws.saturation(j, limit)
    )


def _gain(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    gain = 1.0 + float(rng.choice([-1.0, 1.0])) * loguniform(rng, 0.008, 0.35)
    return Concealed("actuator_gain_error", _joint(c, j), {"gain": (gain, "1")}, laws.gain_error(j, gain))


def _bias(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    torque = float(rng.choice([-1.0, 1.0])) * _share(rng) * c.effort(j)
    return Concealed("actuator_bias", _joint(c, j), {"torque": (torque, c.unit(j, "N m"))}, laws.bias(j, torque))


def _dead_zone(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    width = _share(rng) * c.effort(j)
    return Concealed("actuator_dead_zone", _joint(c, j), {"width": (width, c.unit(j, "N m"))}, laws.dead_zone(j, width))


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
    "payload": draw_link.payload,
    "gravity_misalignment": draw_link.gravity,
    "aerodynamic_drag": draw_link.drag,
    "external_disturbance": draw_link.disturbance,
    "unmodeled_contact": draw_link.unmodeled,
    **{
        name: draw_link.sensor(name)
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
