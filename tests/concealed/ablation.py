"""Ablations of real machines: a known effect removed from the model, or an error added to model or recordings.

Each alteration is exact: the real machine then has, beyond its altered model and recordings, the effect that is named.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from .robots import Array

Tables = Mapping[str, pd.DataFrame]


@dataclass(frozen=True)
class Machine:
    """A scenario, its model file's text and its recordings by name."""

    scenario: dict[str, object]
    model: str
    tables: Tables

    def with_column(self, name: str, change: Callable[[Array, Array], Array]) -> Machine:
        """`change(time, values)` in place of the column `name` of every recording."""
        changed = {
            key: table.assign(**{name: change(table["time"].to_numpy(), table[name].to_numpy())})
            for key, table in self.tables.items()
        }
        return replace(self, tables=changed)


@dataclass(frozen=True)
class Ablation:
    """An altered machine, with the effect that a diagnosis has to name; `equal` are exact other names of it."""

    machine: Machine
    effect: str
    at: str
    parameters: Mapping[str, float]
    equal: tuple[tuple[str, str], ...] = ()


def later(time: Array, values: Array, by: float) -> Array:
    """The value of `time + by`; the ends are held."""
    return np.interp(time + by, time, values)


def late_actuator(machine: Machine, joint: str, delay: float) -> Ablation:
    """Efforts are written `delay` before they act; whole samples, since an effort is held from sample to sample."""
    step = float(np.median(np.diff(next(iter(machine.tables.values()))["time"])))
    samples = max(1, round(delay / step))

    def ahead(time: Array, values: Array) -> Array:
        return np.concatenate([values[samples:], np.full(samples, values[-1])])

    altered = machine.with_column(f"u.{joint}", ahead)
    # where one position is all that is measured, a late effort and a late position are one
    measured = [str(name) for name in next(iter(machine.tables.values())).columns if str(name).startswith(("q.", "v."))]
    equal = (("sensor_delay", measured[0]),) if len(measured) == 1 else ()
    return Ablation(altered, "actuator_delay", joint, {"delay": samples * step}, equal)


def weak_actuator(machine: Machine, joint: str, gain: float) -> Ablation:
    """Efforts are written too large: `gain` times what is written acts."""
    return Ablation(
        machine.with_column(f"u.{joint}", lambda _, u: u / gain), "actuator_gain_error", joint, {"gain": gain}
    )


def biased_actuator(machine: Machine, joint: str, torque: float) -> Ablation:
    return Ablation(
        machine.with_column(f"u.{joint}", lambda _, u: u - torque), "actuator_bias", joint, {"torque": torque}
    )


def biased_sensor(machine: Machine, channel: str, bias: float) -> Ablation:
    # turning the first joint's zero turns gravity: at a joint across gravity the two are one
    first = channel == f"q.{joints(machine)[0]}"
    equal = (("gravity_misalignment", "world"),) if first else ()
    return Ablation(machine.with_column(channel, lambda _, y: y + bias), "sensor_bias", channel, {"bias": bias}, equal)


def wrong_sensor_gain(machine: Machine, channel: str, gain: float) -> Ablation:
    return Ablation(machine.with_column(channel, lambda _, y: gain * y), "sensor_gain_error", channel, {"gain": gain})


def late_sensor(machine: Machine, channel: str, delay: float) -> Ablation:
    altered = machine.with_column(channel, lambda t, y: later(t, y, -delay))
    return Ablation(altered, "sensor_delay", channel, {"delay": delay})


def drifting_sensor(machine: Machine, channel: str, rate: float) -> Ablation:
    return Ablation(machine.with_column(channel, lambda t, y: y + rate * t), "sensor_drift", channel, {"rate": rate})


def lost_mass(machine: Machine, body: str, mass: float, position: Array) -> Ablation:
    """The model's `body` without a point of `mass` at `position` (3,) m, body frame.

    Raises `ValueError` where the body does not have so much there: the rest would not be a rigid body.
    """
    tree = ET.fromstring(machine.model)
    inertial = tree.find(f"link[@name='{body}']/inertial")
    assert inertial is not None
    origin, weight, inertia = (inertial.find(name) for name in ("origin", "mass", "inertia"))
    assert origin is not None and weight is not None and inertia is not None
    p_BoBcm_B = np.array([float(x) for x in origin.get("xyz", "").split()])
    before = float(weight.get("value", "nan"))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    a = {name: float(inertia.get(name, "nan")) for name in names}
    matrix = np.array([[a["ixx"], a["ixy"], a["ixz"]], [a["ixy"], a["iyy"], a["iyz"]], [a["ixz"], a["iyz"], a["izz"]]])
    after = before - mass
    rest = (before * p_BoBcm_B - mass * position) / after
    about_rest = (
        matrix + before * _parallel(p_BoBcm_B) - mass * _parallel(position) - after * _parallel(rest)
    )  # parallel axes, through the body's origin and back
    if np.linalg.eigvalsh(0.5 * np.trace(about_rest) * np.eye(3) - about_rest).min() < 0.0:
        raise ValueError(f"{body} without {mass} kg at {position} is no rigid body")
    weight.set("value", repr(after))
    origin.set("xyz", " ".join(repr(float(x)) for x in rest))
    for name, (i, j) in zip(names, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), strict=True):
        inertia.set(name, repr(float(about_rest[i, j])))
    parameters = {"mass": mass} | dict(zip("xyz", map(float, position), strict=True))
    altered = replace(machine, model=ET.tostring(tree, encoding="unicode"), scenario=_lighter(machine, body, mass))
    return Ablation(altered, "payload", body, parameters)


def lost_effect(machine: Machine, index: int) -> Ablation:
    """The scenario without one of the effects that are known to be there."""
    effects: list[dict[str, object]] = list(machine.scenario["effects"])  # type: ignore[call-overload]
    gone = effects.pop(index)
    numbers = {key: float(value) for key, value in gone.items() if isinstance(value, float | int)}
    altered = replace(machine, scenario=machine.scenario | {"effects": effects})
    return Ablation(altered, str(gone["effect"]), str(gone["at"]), numbers)


def _parallel(p: Array) -> Array:
    return np.asarray(p @ p * np.eye(3) - np.outer(p, p))


def as_fitted(machine: Machine) -> Machine:
    """The machine whose model file has the masses that its scenario's unknowns stand at; inertias are scaled alike."""
    tree = ET.fromstring(machine.model)
    for entry in machine.scenario.get("unknown", []):  # type: ignore[attr-defined]
        inertial = tree.find(f"link[@name='{entry['body']}']/inertial") if entry.get("parameter") == "mass" else None
        if inertial is None:
            continue
        weight, inertia = inertial.find("mass"), inertial.find("inertia")
        assert weight is not None and inertia is not None
        scale = float(entry["mean"]) / float(weight.get("value", "nan"))
        weight.set("value", repr(float(entry["mean"])))
        for name, value in inertia.items():
            inertia.set(name, repr(scale * float(value)))
    return replace(machine, model=ET.tostring(tree, encoding="unicode"))


def _lighter(machine: Machine, body: str, mass: float) -> dict[str, object]:
    """The scenario that believes in the altered model: the unknown mass has its mean where the model has it."""
    unknown: list[dict[str, object]] = machine.scenario.get("unknown", [])  # type: ignore[assignment]
    changed = [
        entry | {"mean": entry["mean"] - mass}
        if entry.get("parameter") == "mass" and entry.get("body") == body
        else entry  # type: ignore[operator]
        for entry in unknown
    ]
    return machine.scenario | {"unknown": changed}


def dead_actuator(machine: Machine, joint: str, width: float) -> Ablation:
    """Efforts are written as if `width` of each were lost."""
    altered = machine.with_column(f"u.{joint}", lambda _, u: u + width * np.sign(u))
    return Ablation(altered, "actuator_dead_zone", joint, {"width": width})


def lagging_sensor(machine: Machine, channel: str, time_constant: float) -> Ablation:
    """The channel behind a first-order lag, that is at rest before the recording starts."""

    def lagged(time: Array, values: Array) -> Array:
        steps, found = np.exp(-np.diff(time) / time_constant), values.copy()
        for k, keep in enumerate(steps):
            # the value between samples is linear in time
            slope = (values[k + 1] - values[k]) / (time[k + 1] - time[k])
            behind = found[k] - values[k] + slope * time_constant
            found[k + 1] = values[k + 1] - slope * time_constant + behind * keep
        return found

    return Ablation(machine.with_column(channel, lagged), "sensor_lag", channel, {"time_constant": time_constant})


def wrong_lengths(machine: Machine, pose: str, gain: float) -> Ablation:
    """All positions of a pose `gain` times what they were."""
    for axis in "xyz":
        machine = machine.with_column(f"{pose}.{axis}", lambda _, y: gain * y)
    return Ablation(machine, "sensor_gain_error", pose, {"gain": gain})


def raised_surface(machine: Machine, body: str, surface: str, offset: float) -> Ablation:
    """The ground, and all that happens on it, raised by `offset`."""
    altered = machine.with_column(f"pose.{body}.z", lambda _, z: z + offset)
    return Ablation(altered, "surface_offset", surface, {"offset": offset}, (("sensor_bias", f"pose.{body}.z"),))


def skewed_clock(machine: Machine, sensor: str, skew: float) -> Ablation:
    """A clock by which a sample of the time t was taken at t (1 + skew)."""
    altered = machine.with_column("time", lambda time, _: time / (1.0 + skew))
    return Ablation(altered, "clock_skew", sensor, {"skew": skew})


def joints(machine: Machine) -> list[str]:
    columns = next(iter(machine.tables.values())).columns
    return [str(name).removeprefix("q.") for name in columns if str(name).startswith("q.")]
