"""Cases on thrown bodies, of which only the pose is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from . import timing
from .arm_case import MEMBERS, verdict
from .case import RECORDINGS, Case
from .contact_law import ContactLaw
from .draw_contact import ContactContext, draw_contact
from .draw_link import misaligned_gravity
from .laws import pulse
from .noise import ChannelNoise, Clock, loguniform
from .robots import Array, Link
from .toss import Shape, Toss
from .truth import CONTACT, Channels, Concealed
from .urdf import box, free_body_urdf, sphere

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
ON_TOSS = (
    *CONTACT,
    "payload",
    "gravity_misalignment",
    "aerodynamic_drag",
    "external_disturbance",
    "sensor_gain_error",
    "clock_skew",
)
ODD_TOSS = ("odd_magnus_lift", "odd_patchy_ground", "odd_wind_gusts", "odd_ageing_ground")


def _random_body(rng: np.random.Generator, ball: bool) -> tuple[Link, Shape, str]:
    mass = float(np.round(rng.uniform(0.1, 0.5), 3))
    if ball:
        radius = float(np.round(rng.uniform(0.03, 0.06), 4))
        inertia = np.eye(3) * rng.uniform(0.4, 0.6) * mass * radius**2
        return Link("ball", mass, np.zeros(3), inertia), Shape(radius), sphere(radius)
    extents = np.round(rng.uniform(0.06, 0.14, 3), 4)
    inertia = mass / 12.0 * np.diag(np.sum(extents**2) - extents**2)
    return Link("block", mass, np.zeros(3), inertia), Shape(extents=tuple(float(e) for e in extents)), box(extents)


def _starts(rng: np.random.Generator, shape: Shape) -> Array:
    """Throws (B, 13) from hand height, low enough to slide and roll before the recording ends."""
    out = np.zeros((MEMBERS, 13))
    reach = shape.radius or 0.5 * float(np.linalg.norm(shape.extents))
    for b in range(MEMBERS):
        out[b, :3] = [*rng.uniform(-0.2, 0.2, 2), reach + rng.uniform(0.02, 0.2)]
        q = Rotation.random(rng=rng).as_quat()
        out[b, 3:7] = [q[3], *q[:3]]
        out[b, 7:10] = [*rng.uniform(-1.0, 1.0, 2), rng.uniform(-0.3, 0.4)]
        out[b, 10:13] = rng.normal(0.0, 6.0 if shape.radius else 3.0, 3)
    return out


def make_toss(rng: np.random.Generator, kind: str, only: int | None = None) -> Case:
    """A case of four throws; kind: null, single:<effect>, pair[:<effect>,<effect>], odd[:<name>].

    `only` conceals one of the drawn effects and leaves all else as it is, to reckon its strength by itself.
    """
    names = kind.partition(":")[2].split(",")
    ball = bool(rng.random() < 0.6) or "contact_rolling_resistance" in names
    if "contact_anisotropic_friction" in names:
        ball = False if rng.random() < 0.5 else ball
    link, shape, geometry = _random_body(rng, ball)
    nominal = ContactLaw(
        stiffness=float(np.round(rng.uniform(1500.0, 6000.0) * (1.0 if ball else 0.5))),
        damping=float(np.round(rng.uniform(2.0, 10.0), 1)),
        friction=float(np.round(rng.uniform(0.2, 0.55), 3)),
        slip_velocity=0.01,
    )
    law, entries, values = _unknown(rng, nominal, link.name)
    step = float(rng.choice([0.002, 0.0025, 0.004]))
    duration = float(rng.uniform(1.2, 1.8))
    samples = int(duration / step)
    contact = ContactContext(nominal, 4.0 * link.mass * 9.81, 0.4, f"{link.name}/ground", "ground", wobbles=True)
    concealed, toss, sensors = _effects(
        rng, kind, Toss(link, shape, law, np.array([0.0, 0.0, -9.81])), contact, duration, ball, only
    )
    clock = Clock(step, 0.3 if rng.random() < 0.2 else 0.0)
    extra = 1 + int(0.04 * samples)
    time = clock.times(rng, MEMBERS, samples + extra)
    states = toss.run(time, _starts(rng, shape))
    channels = Channels(time, _pose_curves(time, toss, states))
    for sensor in sensors:
        channels = sensor(channels)
    time = time[:, :samples]
    measured = {name: curve(time) for name, curve in channels.columns.items()}
    position, rotation, noise_kind = _noise(rng)
    tables = _tabulate(rng, link.name, time, measured, position, rotation)
    states_std = bool(rng.random() > 0.1)
    scenario = _scenario(link.name, nominal, entries, position, rotation, states_std, noise_kind)
    truth = {
        "kind": kind,
        "rig": "toss_" + ("sphere" if ball else "box"),
        "verdict": verdict(kind, concealed),
        "effects": [item.statement() for item in concealed],
        "nominal_parameters_true": values,
        "noise": {"kind": noise_kind, "position": position.declared_std, "rotation": rotation.declared_std},
        "settings": {"step": step, "samples": samples, "states_std": states_std, "jitter": clock.jitter},
    }
    study = {
        "toss": toss,
        "nominal_law": nominal,
        "link": link,
        "shape": shape,
        "states": states[:, :samples],
        "time": time,
    }
    study |= {
        "measured": measured,
        "effects": concealed,
        "position": position,
        "rotation": rotation,
        "entries": entries,
        "true_law": law,
    }
    return Case(kind, "toss", scenario, f"{link.name}.urdf", free_body_urdf(link, geometry), tables, truth, study)


def _unknown(
    rng: np.random.Generator, nominal: ContactLaw, body: str
) -> tuple[ContactLaw, list[dict[str, object]], dict[str, float]]:
    true, entries, values = nominal, [], {}
    for name, part in (("stiffness", 0.1), ("damping", 0.15), ("friction", 0.08)):
        mean = float(getattr(nominal, name))
        value = float(mean * (1.0 + part * np.clip(rng.normal(), -2.0, 2.0)))
        true = replace(true, **{name: value})
        entries.append({"parameter": name, "contact": [body, "ground"], "mean": mean, "std": part * mean})
        values[name] = value
    return true, entries, values


Sensors = list[Callable[[Channels], Channels]]


def _effects(
    rng: np.random.Generator,
    kind: str,
    toss: Toss,
    contact: ContactContext,
    duration: float,
    ball: bool,
    only: int | None,
) -> tuple[tuple[Concealed, ...], Toss, Sensors]:
    head, _, names = kind.partition(":")
    if head == "null":
        return (), toss, []
    if head == "odd":
        item, toss = _odd(rng, names or str(rng.choice(ODD_TOSS)), toss, contact)
        return (item,), toss, []
    allowed = [effect for effect in ON_TOSS if ball or effect != "contact_rolling_resistance"]
    chosen = names.split(",") if names else [str(rng.choice(allowed))]
    if head == "pair" and len(chosen) < 2:
        chosen.append(
            str(rng.choice([effect for effect in allowed if effect.split("_")[0] != chosen[0].split("_")[0]]))
        )
    concealed: list[Concealed] = []
    sensors: Sensors = []
    for index, effect in enumerate(chosen):
        item, changed = _one(rng, effect, toss, contact, duration)
        if only is not None and index != only:
            continue
        toss = changed
        concealed.append(item)
        if item.sensor:
            sensors.append(item.sensor)
    return tuple(concealed), toss, sensors


def _one(
    rng: np.random.Generator, effect: str, toss: Toss, contact: ContactContext, duration: float
) -> tuple[Concealed, Toss]:
    body, mass = toss.link.name, toss.link.mass
    if effect in CONTACT:
        item = draw_contact(rng, contact, effect)
        return item, replace(toss, law=replace(toss.law, **item.contact))  # type: ignore[arg-type]
    if effect == "payload":
        added = mass * loguniform(rng, 0.01, 0.5)
        reach = toss.shape.radius or 0.5 * min(toss.shape.extents)
        direction = rng.normal(size=3)
        p = rng.uniform(0.3, 0.95) * reach * direction / np.linalg.norm(direction)
        told = {"mass": (added, "kg")} | {name: (float(value), "m") for name, value in zip("xyz", p, strict=True)}
        return Concealed(effect, body, told, place_kind="body"), replace(toss, link=toss.link.with_point_mass(added, p))
    if effect == "gravity_misalignment":
        item, gravity = misaligned_gravity(rng)
        return item, replace(toss, gravity=gravity)
    if effect == "aerodynamic_drag":
        coefficient = loguniform(rng, 0.01, 1.0)
        return Concealed(effect, body, {"coefficient": (coefficient, "N s^2/m^2")}, place_kind="body"), replace(
            toss, drag=coefficient
        )
    if effect == "external_disturbance":
        return _disturbed(rng, toss, duration)
    if effect == "sensor_gain_error":
        gain = 1.0 + float(rng.choice([-1.0, 1.0])) * loguniform(rng, 2e-3, 0.1)
        sensor = timing.scaled([f"pose.{body}.{axis}" for axis in "xyz"], gain)
        return Concealed(effect, f"pose.{body}", {"gain": (gain, "1")}, sensor=sensor, place_kind="sensor"), toss
    if effect == "clock_skew":
        skew = float(rng.choice([-1.0, 1.0])) * loguniform(rng, 1e-3, 3e-2)
        sensor = timing.skewed([f"pose.{body}.{axis}" for axis in POSE], skew)
        return Concealed(effect, f"pose.{body}", {"skew": (skew, "1")}, sensor=sensor, place_kind="sensor"), toss
    raise ValueError(f"{effect}: not on a toss")


def _disturbed(rng: np.random.Generator, toss: Toss, duration: float) -> tuple[Concealed, Toss]:
    direction = rng.normal(size=3)
    peak = toss.link.mass * 9.81 * loguniform(rng, 0.1, 5.0) * direction / np.linalg.norm(direction)
    width = loguniform(rng, 0.06, 0.3)
    first = float(rng.uniform(0.1, duration - width - 0.1))
    member = int(rng.integers(3))
    interval = (first, first + width)
    told = {name: (float(value), "N") for name, value in zip("xyz", peak, strict=True)}
    item = Concealed(
        "external_disturbance", toss.link.name, told, interval=interval, recording=RECORDINGS[member], place_kind="body"
    )
    return item, replace(toss, at_origin=lambda t, p, v: pulse(t, interval, member)[:, None] * peak)


def _odd(rng: np.random.Generator, name: str, toss: Toss, contact: ContactContext) -> tuple[Concealed, Toss]:
    if name == "odd_magnus_lift":
        lift = toss.link.mass * loguniform(rng, 0.2, 1.5)
        return Concealed(name, toss.link.name, {"lift": (lift, "kg")}, place_kind="body"), replace(toss, magnus=lift)
    if name == "odd_wind_gusts":
        peak = toss.link.mass * 9.81 * loguniform(rng, 0.05, 0.6)
        frequency, phase = rng.uniform(1.5, 4.0, 3), rng.uniform(0.0, 6.28, 3)

        def force(t: Array, p: Array, v: Array) -> Array:
            return peak * np.sin(2.0 * np.pi * frequency * (t + 1.7 * np.arange(len(t)))[:, None] + phase)

        return Concealed(name, toss.link.name, {"peak": (peak, "N")}, place_kind="body"), replace(toss, at_origin=force)
    if name == "odd_patchy_ground":
        changes: dict[str, object] = {
            "patch": (loguniform(rng, 0.3, 0.9), float(rng.uniform(15.0, 50.0)), float(rng.uniform(0.0, 6.28)))
        }
    elif name == "odd_ageing_ground":
        changes = {"ageing": loguniform(rng, 1.0, 6.0)}
    else:
        raise ValueError(f"{name}: not on a toss")
    item = Concealed(
        name, contact.pair, {"size": (float(np.ravel(next(iter(changes.values())))[0]), "1")}, place_kind="contact"
    )
    return item, replace(toss, law=replace(toss.law, **changes))  # type: ignore[arg-type]


def _pose_curves(time: Array, toss: Toss, states: Array) -> dict[str, timing.Curve]:
    """Cubic curves through the origin's path and the quaternion, whose sign is made continuous."""
    origin = toss.origin(states)
    omega, v = states[:, :, 10:13], states[:, :, 7:10]
    velocity = v + np.cross(omega, origin - states[:, :, :3])
    q = states[:, :, 3:7].copy()
    for k in range(1, q.shape[1]):
        q[:, k] *= np.where(np.sum(q[:, k] * q[:, k - 1], axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    w, xyz = q[:, :, :1], q[:, :, 1:]
    rate = 0.5 * np.concatenate([-np.sum(omega * xyz, axis=2, keepdims=True), w * omega + np.cross(omega, xyz)], axis=2)
    columns = {}
    for i, axis in enumerate("xyz"):
        columns[f"pose.{toss.link.name}.{axis}"] = timing.velocity_curve(time, origin[:, :, i], velocity[:, :, i])
    for i, axis in enumerate(POSE[3:]):
        columns[f"pose.{toss.link.name}.{axis}"] = timing.velocity_curve(time, q[:, :, i], rate[:, :, i])
    return columns


def _noise(rng: np.random.Generator) -> tuple[ChannelNoise, ChannelNoise, str]:
    position, rotation = loguniform(rng, 3e-5, 5e-4), loguniform(rng, 5e-4, 6e-3)
    if rng.random() < 0.2:
        time = loguniform(rng, 0.005, 0.03)
        return ChannelNoise(position, time), ChannelNoise(rotation, time), "coloured_declared"
    return ChannelNoise(position), ChannelNoise(rotation), "white"


def _tabulate(
    rng: np.random.Generator,
    body: str,
    time: Array,
    measured: dict[str, Array],
    position: ChannelNoise,
    rotation: ChannelNoise,
) -> dict[str, pd.DataFrame]:
    shift, turn = position.draw(rng, time, 3), rotation.draw(rng, time, 3)
    tables = {}
    for b, file in enumerate(RECORDINGS):
        q = np.column_stack([measured[f"pose.{body}.{axis}"][b] for axis in ("qx", "qy", "qz", "qw")])
        turned = (Rotation.from_rotvec(turn[b]) * Rotation.from_quat(q)).as_quat()
        sign = np.sign(np.sum(turned * q, axis=1, keepdims=True))
        turned *= sign
        table: dict[str, Array] = {"time": np.round(time[b], 9)}
        for i, axis in enumerate("xyz"):
            table[f"pose.{body}.{axis}"] = measured[f"pose.{body}.{axis}"][b] + shift[b, :, i]
        for axis, column in zip(("qw", "qx", "qy", "qz"), (3, 0, 1, 2), strict=True):
            table[f"pose.{body}.{axis}"] = turned[:, column]
        tables[file] = pd.DataFrame(table)
    return tables


def _scenario(
    body: str,
    law: ContactLaw,
    entries: list[dict[str, object]],
    position: ChannelNoise,
    rotation: ChannelNoise,
    stated: bool,
    kind: str,
) -> dict[str, object]:
    channel: dict[str, object] = {}
    if stated:
        channel["std"] = {"position": position.declared_std, "rotation": rotation.declared_std}
    if kind == "coloured_declared":
        channel["correlation_time"] = position.correlation_time
    contact = {
        "bodies": [body, "ground"],
        "ground": {"point": [0, 0, 0], "normal": [0, 0, 1]},
        "stiffness": law.stiffness,
        "damping": law.damping,
        "friction": law.friction,
        "slip_velocity": law.slip_velocity,
    }
    return {
        "model": f"{body}.urdf",
        "gravity": [0, 0, -9.81],
        "channels": {f"pose.{body}": channel},
        "unknown": entries,
        "contact": [contact],
    }
