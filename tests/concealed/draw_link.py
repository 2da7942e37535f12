"""Random effects on links, on the world and on an arm's encoders."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from . import laws, timing
from .arm_context import ArmContext, Draw
from .mujoco_arm import ArmInverse
from .noise import loguniform
from .robots import Array, Robot
from .truth import Concealed


def _carried(rng: np.random.Generator, c: ArmContext) -> int:
    """A link that moves, more often one far out."""
    first = min(c.moving())
    links = c.robot.descendants(first)
    weights = np.arange(1.0, len(links) + 1.0)
    return int(rng.choice(links, p=weights / weights.sum()))


def payload(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    link = _carried(rng, c)
    body = c.robot.links[link]
    mass = loguniform(rng, 0.01, 0.6) * body.mass
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
    size, angle = loguniform(rng, 2e-3, 0.2), rng.uniform(0.0, 2.0 * np.pi)
    roll, pitch = float(size * np.cos(angle)), float(size * np.sin(angle))
    gravity = (
        Rotation.from_euler("x", roll).as_matrix() @ Rotation.from_euler("y", pitch).as_matrix() @ [0.0, 0.0, -9.81]
    )

    def change(robot: Robot) -> Robot:
        return Robot(robot.name, robot.links, robot.joints, gravity)

    told = {"roll": (roll, "rad"), "pitch": (pitch, "rad")}
    return Concealed("gravity_misalignment", "world", told, change=change, place_kind="environment"), gravity


def gravity(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    return misaligned_gravity(rng)[0]


def drag(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    link = _carried(rng, c)
    coefficient = loguniform(rng, 0.1, 20.0)
    body = c.robot.links[link]
    return Concealed(
        "aerodynamic_drag",
        body.name,
        {"coefficient": (coefficient, "N s^2/m^2")},
        laws.drag(link, body.com, coefficient),
        place_kind="body",
    )


def disturbance(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
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


def unmodeled(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
    """A plane across the path of a far link's origin, touched for a few percent of the time."""
    links = list(range(max(1, c.robot.size // 2), c.robot.size))
    link = int(rng.choice(links))
    normal = rng.normal(size=3) + np.array([0.0, 0.0, 0.8])
    normal /= np.linalg.norm(normal)
    path = ArmInverse(c.robot).point(c.q[:, ::10].reshape(-1, c.robot.size), link, np.zeros(3)) @ normal
    offset = float(np.quantile(path, rng.uniform(0.03, 0.2)))
    depth = max(offset - float(path.min()), 2e-3)
    stiffness = loguniform(rng, 0.5, 60.0) / depth
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
    return f"{'v' if velocity else 'q'}.{c.robot.joints[j].name}", velocity


def sensor(effect: str) -> Draw:
    def draw(rng: np.random.Generator, c: ArmContext, j: int) -> Concealed:
        channel, velocity = _channel(rng, c, j)
        linear = 0.2 if c.robot.joints[j].kind == "prismatic" else 1.0
        sign = float(rng.choice([-1.0, 1.0]))
        unit = c.unit(j, "rad/s" if velocity else "rad")
        if effect == "sensor_bias":
            amount = sign * linear * loguniform(rng, 1e-3, 0.15)
            return Concealed(effect, channel, {"bias": (amount, unit)}, sensor=timing.biased([channel], amount))
        if effect == "sensor_gain_error":
            gain = 1.0 + sign * loguniform(rng, 5e-3, 0.25)
            return Concealed(effect, channel, {"gain": (gain, "1")}, sensor=timing.scaled([channel], gain))
        if effect == "sensor_drift":
            rate = sign * linear * loguniform(rng, 5e-4, 5e-2)
            return Concealed(effect, channel, {"rate": (rate, unit + "/s")}, sensor=timing.drifting([channel], rate))
        if effect == "clock_skew":
            skew = sign * loguniform(rng, 3e-4, 2e-2)
            return Concealed(effect, channel, {"skew": (skew, "1")}, sensor=timing.skewed([channel], skew))
        seconds = loguniform(rng, 1e-3, 3e-2)
        if effect == "sensor_delay":
            return Concealed(effect, channel, {"delay": (seconds, "s")}, sensor=timing.delayed([channel], seconds))
        return Concealed(effect, channel, {"time_constant": (seconds, "s")}, sensor=timing.lagged([channel], seconds))

    return draw
