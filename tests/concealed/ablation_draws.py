"""Draws of sealed alterations: kind by slot, place and strength from the system's entropy, for every real machine.

A strength is drawn by what it changes: 20 to 50 % of the effort of its joint where an effort changes, so that what is
concealed is neither faint nor absurd on any of the machines.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from scipy.signal import butter, sosfiltfilt

from drake_cafim.diagnosis.rows.filtered_windows import apply_filter
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.link import Payload, TreeEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene

from . import ablation
from .ablation import Ablation, Machine
from .machines import SETS
from .robots import Array

Draw = Callable[[Machine, np.random.Generator], Ablation]
LEAST, MOST = 0.2, 0.5
"""Change of an effort, rms over rms."""
FELT = 0.15
"""Least change of a velocity, or of the efforts that a position needs, rms over rms, where the strength allows it."""
LONGEST = 0.1
"""s, the longest delay or time constant."""
SMOOTHING = 15.0
"""Hz, cutoff of the positions along which forces are computed."""


def _share(rng: np.random.Generator) -> float:
    return float(rng.uniform(LEAST, MOST))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _joint(machine: Machine, rng: np.random.Generator) -> str:
    return str(rng.choice(ablation.joints(machine)))


def _rms(machine: Machine, column: str) -> float:
    return float(np.sqrt(np.mean(np.concatenate([table[column].to_numpy() ** 2 for table in machine.tables.values()]))))


def scene_of(machine: Machine) -> Scene:
    """The machine's scene, without what is unknown of it."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / str(machine.scenario["model"])).write_text(machine.model)
        (folder / "scenario.yaml").write_text(yaml.safe_dump(machine.scenario | {"unknown": []}))
        return Scene.load(folder / "scenario.yaml")


def smooth_motion(table: Mapping[str, Array], names: Sequence[str]) -> tuple[Array, Array, Array]:
    """q, v, v̇ (N, n) of a recording, its positions low-passed without phase lag."""
    time = np.asarray(table["time"])
    rate = 1.0 / float(np.median(np.diff(time)))
    sections = butter(2, min(SMOOTHING, 0.3 * rate), fs=rate, output="sos")
    q = sosfiltfilt(sections, np.stack([np.asarray(table[f"q.{name}"]) for name in names], axis=1), axis=0)
    v = np.gradient(q, time, axis=0)
    return np.asarray(q), np.asarray(v), np.asarray(np.gradient(v, time, axis=0))


def with_efforts(machine: Machine, scene: Scene, change: Callable[[Array, Array, Array], Array]) -> Machine:
    """Efforts changed by `change(q, v, v̇)` (N, n), filtered as the maker filtered them.

    An effort that is held acts from its sample to the next: of the change it is the mean over that interval.
    """
    names, tables = scene.tree.joint_names, {}
    for key, table in machine.tables.items():
        more = change(*smooth_motion({str(c): table[c].to_numpy() for c in table.columns}, names))
        channel = scene.channel(f"u.{names[0]}")
        if channel is None or channel.hold == "zero_order":
            more = 0.5 * (more + np.concatenate([more[1:], more[-1:]]))
        if channel is not None and channel.lowpass is not None:
            more = apply_filter(channel.lowpass, more, 1.0 / float(np.median(np.diff(table["time"]))))
        tables[key] = table.assign(**{f"u.{name}": table[f"u.{name}"] + more[:, j] for j, name in enumerate(names)})
    return replace(machine, tables=tables)


def joint_force(name: str, strength: str, **others: float) -> Draw:
    """A force law at a joint that the recorded efforts overcome, besides what they did."""

    def draw(machine: Machine, rng: np.random.Generator) -> Ablation:
        scene, joint = scene_of(machine), _joint(machine, rng)
        j, share = scene.tree.joint_index(joint), _share(rng)

        def efforts(amount: float) -> Callable[[Array, Array, Array], Array]:
            effect = effect_named(name)(joint, {strength: amount, **_shaped(scene, machine, joint, others, rng_state)})
            assert isinstance(effect, JointForce)

            def change(q: Array, v: Array, a: Array) -> Array:
                more = np.zeros_like(q)
                more[:, j] = -effect.force(JointSamples(q[:, j].copy(), v[:, j].copy(), np.zeros(len(q)))).value
                return more

            return change

        rng_state = float(rng.uniform())
        unit = with_efforts(machine, scene, efforts(1.0))
        by_one = _change(machine, unit, f"u.{joint}")
        amount = share * _rms(machine, f"u.{joint}") / by_one
        altered = with_efforts(machine, scene, efforts(amount))
        values = {strength: amount, **_shaped(scene, machine, joint, others, rng_state)}
        return Ablation(altered, name, joint, values)

    return draw


def _shaped(scene: Scene, machine: Machine, joint: str, others: Mapping[str, float], chance: float) -> dict[str, float]:
    """The other parameters of a law: as given, or, where NaN, from the joint's range."""
    q = np.concatenate([table[f"q.{joint}"].to_numpy() for table in machine.tables.values()])
    ranged = {
        "rest": float(np.mean(q) + (chance - 0.5) * np.std(q)),
        "cycles": float(2.0 * np.pi * (3.0 + 4.0 * chance) / np.ptp(q)),
        "phase": float(2.0 * np.pi * chance - np.pi),
    }
    return {name: ranged[name] if np.isnan(value) else value for name, value in others.items()}


def _change(before: Machine, after: Machine, column: str) -> float:
    squares = [np.mean((after.tables[key][column] - table[column]) ** 2) for key, table in before.tables.items()]
    return float(np.sqrt(np.mean(squares)))


def dynamic(make: Callable[[Scene, float, np.random.Generator], TreeEffect], first: str) -> Draw:
    """An effect on inertia or gravity as the exact change of the efforts that the recorded motion then needs."""

    def draw(machine: Machine, rng: np.random.Generator) -> Ablation:
        scene, share, state = scene_of(machine), _share(rng), rng.integers(2**31)

        def altered(effect: TreeEffect) -> Machine:
            before = scene.physics
            after = before.with_effects([effect])

            def change(q: Array, v: Array, a: Array) -> Array:
                return _inverse(after, q, v, a) - _inverse(before, q, v, a)

            return with_efforts(machine, scene, change)

        small = make(scene, 1e-2, np.random.default_rng(state))
        item = altered(small)
        felt = [_change(machine, item, f"u.{n}") / _rms(machine, f"u.{n}") for n in scene.tree.joint_names]
        effect = make(scene, 1e-2 * share / max(felt), np.random.default_rng(state))
        return Ablation(altered(effect), effect.name, effect.at, dict(effect.values))

    return draw


def _inverse(physics: Physics, q: Array, v: Array, a: Array) -> Array:
    M, bias = equations_of_motion(motion(physics.tree, q, v), physics.gravity)
    return np.asarray(np.einsum("nij,nj->ni", M, a) + bias + physics.rotor_inertias * a)


def _payload(scene: Scene, amount: float, rng: np.random.Generator) -> TreeEffect:
    carrying = [body.name for body in scene.tree.bodies if body.joint >= 0 and body.mass > 0.0]
    place = rng.uniform(-0.15, 0.15, 3)
    at = carrying[int(rng.integers(len(carrying) // 2, len(carrying)))]
    return Payload(at, {"mass": amount, **dict(zip("xyz", map(float, place), strict=True))})


def _tilt(scene: Scene, amount: float, rng: np.random.Generator) -> TreeEffect:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    values = {"roll": amount * float(np.cos(angle)), "pitch": amount * float(np.sin(angle))}
    return effect_named("gravity_misalignment")("world", values)  # type: ignore[return-value]


def _rotor(scene: Scene, amount: float, rng: np.random.Generator) -> TreeEffect:
    return effect_named("rotor_inertia")(str(rng.choice(scene.tree.joint_names)), {"inertia": amount})  # type: ignore[return-value]


def wrong_mass(machine: Machine, rng: np.random.Generator) -> Ablation:
    """A link of the model without a third to a half of its mass, its inertia scaled alike."""
    tree = ET.fromstring(machine.model)
    moving = {body.name for body in scene_of(machine).tree.bodies if body.joint >= 0 and body.mass > 0.0}
    links = [link for link in tree.findall("link") if link.get("name") in moving]
    link = links[int(rng.integers(len(links)))]
    weight, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    assert weight is not None and inertia is not None
    factor, name = float(rng.uniform(0.5, 0.7)), str(link.get("name"))
    mass = float(weight.get("value", "nan"))
    weight.set("value", repr(factor * mass))
    for key, value in inertia.items():
        inertia.set(key, repr(factor * float(value)))
    unknown = [
        entry | {"mean": factor * mass} if (entry.get("parameter"), entry.get("body")) == ("mass", name) else entry
        for entry in machine.scenario.get("unknown", [])  # type: ignore[attr-defined]
    ]
    altered = replace(
        machine, model=ET.tostring(tree, encoding="unicode"), scenario=machine.scenario | {"unknown": unknown}
    )
    equal = (("inertial_error", name), ("payload", name), ("inertials", name))
    return Ablation(altered, "mass", name, {"mass": mass}, equal)


def lost_effect(machine: Machine, rng: np.random.Generator) -> Ablation:
    """The scenario without one of the frictions that are known to be there; another kind where none is."""
    effects: list[dict[str, object]] = machine.scenario.get("effects", [])  # type: ignore[assignment]
    friction = [index for index, effect in enumerate(effects) if "friction" in str(effect["effect"])]
    if not friction:
        return joint_force("joint_viscous_friction", "coefficient")(machine, rng)
    return ablation.lost_effect(machine, int(rng.choice(friction)))


def late_actuator(machine: Machine, rng: np.random.Generator) -> Ablation:
    """Efforts that are written before they act, by as many samples as change them by the drawn share."""
    joint, share = _joint(machine, rng), _share(rng)
    step = float(np.median(np.diff(next(iter(machine.tables.values()))["time"])))
    for samples in range(1, 60):
        made = ablation.late_actuator(machine, joint, samples * step)
        if _change(machine, made.machine, f"u.{joint}") > share * _rms(machine, f"u.{joint}") or samples * step > 0.08:
            return made
    return made


def _velocity(machine: Machine, rng: np.random.Generator) -> str:
    """A velocity column, or a position where no velocity is measured, or none that serves."""
    joint, columns = _joint(machine, rng), next(iter(machine.tables.values())).columns
    channels: dict[str, dict[str, object]] = machine.scenario.get("channels", {})  # type: ignore[assignment]
    serves = f"v.{joint}" in columns and "lowpass" not in (channels.get("v") or {})
    return f"v.{joint}" if serves else f"q.{joint}"


ARM: Mapping[str, Draw] = {
    "link mass": wrong_mass,
    "rotor": dynamic(_rotor, "inertia"),
    "gravity": dynamic(_tilt, "roll"),
    "payload": dynamic(_payload, "mass"),
    "known friction": lost_effect,
    "viscous": joint_force("joint_viscous_friction", "coefficient"),
    "Coulomb": joint_force("joint_coulomb_friction", "torque"),
    "spring": joint_force("joint_spring", "stiffness", rest=np.nan),
    "ripple": joint_force("torque_ripple", "amplitude", cycles=np.nan, phase=np.nan),
    "delay": late_actuator,
    "gain": lambda m, rng: ablation.weak_actuator(m, _joint(m, rng), float(rng.choice([0.6, 0.7, 1.4, 1.6]))),
    "bias": lambda m, rng: _biased(m, _joint(m, rng), rng),
    "dead zone": lambda m, rng: _dead(m, _joint(m, rng), rng),
    "position bias": lambda m, rng: _of_column(m, f"q.{_joint(m, rng)}", ablation.biased_sensor, 0.05, 0.1, rng, 1.0),
    "drift": lambda m, rng: _of_column(
        m, f"q.{_joint(m, rng)}", ablation.drifting_sensor, 0.1 / _longest(m), 0.3 / _longest(m), rng, 1.0
    ),
    "velocity scale": lambda m, rng: ablation.wrong_sensor_gain(
        m, _velocity(m, rng), float(rng.choice([0.8, 0.9, 1.1, 1.25]))
    ),
    "late sensor": lambda m, rng: _of_column(m, _velocity(m, rng), _late, 0.01, 0.04, rng, LONGEST),
    "lag": lambda m, rng: _of_column(m, _velocity(m, rng), _lagging, 0.01, 0.04, rng, LONGEST),
}
"""Kinds of alteration of a robot by name."""


def _biased(machine: Machine, joint: str, rng: np.random.Generator) -> Ablation:
    return ablation.biased_actuator(machine, joint, _sign(rng) * _share(rng) * _rms(machine, f"u.{joint}"))


def _dead(machine: Machine, joint: str, rng: np.random.Generator) -> Ablation:
    return ablation.dead_actuator(machine, joint, _share(rng) * _rms(machine, f"u.{joint}"))


def _of_column(
    machine: Machine,
    column: str,
    make: Callable[[Machine, str, float], Ablation],
    least: float,
    most: float,
    rng: np.random.Generator,
    farthest: float,
) -> Ablation:
    """An alteration of a column by an amount between `least` and `most`, larger where it is hardly felt.

    Its sign is drawn where it may have one. The amount is at most `farthest`.
    """
    amount = float(rng.uniform(least, most)) * (1.0 if make in (_late, _lagging) else _sign(rng))
    made = make(machine, column, amount)
    while felt(machine, made) < FELT and abs(1.5 * amount) <= farthest:
        amount *= 1.5
        made = make(machine, column, amount)
    return made


def felt(machine: Machine, made: Ablation) -> float:
    """How much an altered column changes: a velocity over its rms; a position by the efforts that its motion needs."""
    if made.at.startswith("v."):
        return _change(machine, made.machine, made.at) / _rms(machine, made.at)
    scene = scene_of(machine)
    names, needed = scene.tree.joint_names, []
    for item in (machine, made.machine):
        paths = [{str(c): table[c].to_numpy() for c in table.columns} for table in item.tables.values()]
        needed.append(np.concatenate([_inverse(scene.physics, *smooth_motion(path, names)) for path in paths]))
    efforts = [_rms(machine, f"u.{name}") for name in names]
    return float(np.max(np.sqrt(np.mean((needed[1] - needed[0]) ** 2, axis=0)) / efforts))


def _late(machine: Machine, column: str, delay: float) -> Ablation:
    return _where_one_is_measured(machine, ablation.late_sensor(machine, column, delay), "actuator_delay")


def _lagging(machine: Machine, column: str, time_constant: float) -> Ablation:
    return _where_one_is_measured(machine, ablation.lagging_sensor(machine, column, time_constant), "actuator_lag")


def _where_one_is_measured(machine: Machine, made: Ablation, other: str) -> Ablation:
    """Where one position is all that is measured, it is late where the effort is."""
    columns = [name for name in next(iter(machine.tables.values())).columns if str(name).startswith(("q.", "v."))]
    return replace(made, equal=((other, ablation.joints(machine)[0]),)) if len(columns) == 1 else made


def _longest(machine: Machine) -> float:
    return max(float(table["time"].iloc[-1] - table["time"].iloc[0]) for table in machine.tables.values())


def _pose(column: str) -> str:
    return f"pose.cube.{column}"


TOSS: Mapping[str, Draw] = {
    "length scale": lambda m, rng: ablation.wrong_lengths(m, "pose.cube", float(rng.choice([0.94, 0.96, 1.04, 1.06]))),
    "pose drift": lambda m, rng: ablation.drifting_sensor(
        m, _pose(str(rng.choice(["x", "y"]))), _sign(rng) * rng.uniform(0.05, 0.15)
    ),
    "surface": lambda m, rng: ablation.raised_surface(m, "cube", "ground", _sign(rng) * rng.uniform(0.004, 0.01)),
    "clock": lambda m, rng: ablation.skewed_clock(m, "pose.cube", _sign(rng) * rng.uniform(0.03, 0.06)),
}
"""Kinds of alteration of a thrown body by name."""
REPEATS = 1
"""How often each kind is drawn on each robot; those of a thrown body four times as often."""


def slots() -> list[tuple[str, str, Draw]]:
    """Machine, kind and draw of every sealed case."""
    found = []
    for name, own in SETS.items():
        kinds, times = (TOSS, 4 * REPEATS) if own.thrown else (ARM, REPEATS)
        shown = {kind: draw for kind, draw in kinds.items() if kind not in own.hidden}
        found += [(name, kind, draw) for _ in range(times) for kind, draw in shown.items()]
    return found
