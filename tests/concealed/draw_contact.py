"""Random effects of contacts, surfaces and wrench sensors, from undetectable to obvious."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from . import timing
from .contact_law import ContactLaw
from .noise import loguniform
from .truth import Concealed

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class ContactContext:
    """Typical size of a contact: force (N), depth (m), sliding speed (m/s); names of pair and surface."""

    law: ContactLaw
    force: float
    speed: float
    pair: str
    surface: str
    wobbles: bool = False  # depth rates large against the sliding ones: tosses

    @property
    def depth(self) -> float:
        return self.force / self.law.stiffness


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def draw_contact(rng: np.random.Generator, c: ContactContext, effect: str) -> Concealed:
    """The effect at the contact or its surface."""
    law, pair = c.law, c.pair

    def made(told: dict[str, tuple[float, str]], at: str = pair, kind: str = "contact", **changes: object) -> Concealed:
        return Concealed(effect, at, told, contact=changes, place_kind=kind)

    if effect == "contact_stribeck_friction":
        static, velocity = law.friction * (1.0 + loguniform(rng, 0.03, 1.5)), c.speed * rng.uniform(0.15, 0.7)
        return made({"static": (static, "1"), "velocity": (velocity, "m/s")}, static=static, stribeck_velocity=velocity)
    if effect == "contact_adhesion":
        force, reach = c.force * loguniform(rng, 0.01, 0.5), loguniform(rng, 2e-4, 3e-3)
        return made({"force": (force, "N"), "range": (reach, "m")}, adhesion=force, adhesion_range=reach)
    if effect == "contact_nonlinear_stiffness":
        cubic = loguniform(rng, 0.01, 1.5) * law.stiffness / c.depth**2
        return made({"cubic": (cubic, "N/m^3")}, cubic=cubic)
    if effect == "contact_viscoelastic_relaxation":
        stiffness, time = law.stiffness * loguniform(rng, 0.03, 1.2), loguniform(rng, 0.01, 0.4)
        return made(
            {"stiffness": (stiffness, "N/m"), "time_constant": (time, "s")}, relaxing=stiffness, relaxation_time=time
        )
    if effect == "contact_hunt_crossley_dissipation":
        dissipation = loguniform(rng, 0.1, 5.0) if c.wobbles else loguniform(rng, 0.3, 40.0)
        return made({"dissipation": (dissipation, "s/m")}, dissipation=dissipation)
    if effect == "contact_rolling_resistance":
        coefficient = loguniform(rng, 4e-4, 1e-2)
        return made({"coefficient": (coefficient, "m")}, rolling=coefficient)
    if effect == "contact_anisotropic_friction":
        part, angle = loguniform(rng, 0.02, 0.6), float(rng.uniform(0.0, np.pi))
        mu = (law.friction * (1.0 + part), law.friction * (1.0 - part), angle)
        told = {"friction_1": (mu[0], "1"), "friction_2": (mu[1], "1"), "angle": (angle, "rad")}
        return made(told, anisotropic=mu)
    if effect == "contact_presliding":
        distance = loguniform(rng, 2e-5, 3e-3)
        return made({"distance": (distance, "m")}, presliding=distance)
    if effect == "surface_offset":
        offset = _sign(rng) * c.depth * loguniform(rng, 0.01, 1.5)
        if c.wobbles:
            offset = _sign(rng) * loguniform(rng, 1e-4, 1e-2)
        return made({"offset": (offset, "m")}, c.surface, offset=offset)
    size, angle = loguniform(rng, 2e-3, 0.12), float(rng.uniform(0.0, 2.0 * np.pi))
    tilt = (float(size * np.cos(angle)), float(size * np.sin(angle)))
    return made({"y_slope_x": (tilt[0], "rad"), "y_slope_y": (tilt[1], "rad")}, c.surface, tilt=tilt)


def draw_wrench(rng: np.random.Generator, c: ContactContext, effect: str, sensor: str = "wrist") -> Concealed:
    """The effect of a wrench sensor or one of its channels."""
    channel = int(rng.choice([0, 1, 2, 2, 3, 4]))
    name = f"wrench.{sensor}.{WRENCH[channel]}"
    arm, unit = (1.0, "N") if channel < 3 else (0.1, "N m")
    whole = [f"wrench.{sensor}.{axis}" for axis in WRENCH]
    at = f"wrench.{sensor}"
    if effect == "sensor_bias":
        amount = _sign(rng) * arm * c.force * loguniform(rng, 0.003, 0.4)
        return Concealed(effect, name, {"bias": (amount, unit)}, sensor=timing.biased([name], amount))
    if effect == "sensor_gain_error":
        gain = 1.0 + _sign(rng) * loguniform(rng, 0.005, 0.4)
        return Concealed(effect, name, {"gain": (gain, "1")}, sensor=timing.scaled([name], gain))
    if effect == "sensor_drift":
        rate = _sign(rng) * arm * c.force * loguniform(rng, 1e-3, 0.1)
        return Concealed(effect, name, {"rate": (rate, unit + "/s")}, sensor=timing.drifting([name], rate))
    if effect == "clock_skew":
        skew = _sign(rng) * loguniform(rng, 2e-4, 1e-2)
        return Concealed(effect, at, {"skew": (skew, "1")}, sensor=timing.skewed(whole, skew))
    if effect == "sensor_misalignment":
        angles = loguniform(rng, 3e-3, 0.3) * _direction(rng)
        rotation = (
            Rotation.from_euler("x", angles[0])
            * Rotation.from_euler("y", angles[1])
            * Rotation.from_euler("z", angles[2])
        ).as_matrix()
        told = {axis: (float(value), "rad") for axis, value in zip(("roll", "pitch", "yaw"), angles, strict=True)}
        return Concealed(effect, at, told, sensor=timing.turned(sensor, rotation))
    seconds = loguniform(rng, 5e-4, 2.5e-2)
    if effect == "sensor_delay":
        return Concealed(effect, at, {"delay": (seconds, "s")}, sensor=timing.delayed(whole, seconds))
    return Concealed(effect, at, {"time_constant": (seconds, "s")}, sensor=timing.lagged(whole, seconds))


def _direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _odd_patch(rng: np.random.Generator, c: ContactContext) -> dict[str, object]:
    return {"patch": (loguniform(rng, 0.25, 0.8), float(rng.uniform(150.0, 500.0)), float(rng.uniform(0.0, 6.28)))}


ODD_CONTACT = {
    "odd_patchy_friction": _odd_patch,
    "odd_plastic_dent": lambda rng, c: {"plastic": loguniform(rng, 0.15, 0.6)},
    "odd_ageing_friction": lambda rng, c: {"ageing": loguniform(rng, 0.12, 0.6)},
    "odd_swinging_attraction": lambda rng, c: {"electric": c.force * loguniform(rng, 0.1, 0.6)},
    "odd_hysteretic_foam": lambda rng, c: {"hysteresis": loguniform(rng, 0.06, 0.35)},
}
_TOLD = {"patch": "1", "plastic": "1", "ageing": "1/s", "electric": "N", "hysteresis": "1"}


def draw_odd_contact(rng: np.random.Generator, c: ContactContext, name: str) -> Concealed:
    """Physics of a contact that the vocabulary has no name for."""
    changes = ODD_CONTACT[name](rng, c)
    told = {key: (float(np.ravel(value)[0]), _TOLD[key]) for key, value in changes.items()}
    return Concealed(name, c.pair, told, contact=changes, place_kind="contact")
