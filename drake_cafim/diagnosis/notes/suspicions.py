"""Possible mistakes of a recording's columns (signs, units, zeros, swapped joints), and the corrected columns."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from drake_cafim.diagnosis.fit.data_mistakes import Suspicion
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.dynamics.motion import bias_force, motion
from drake_cafim.numerics.rounding import listed, rounded
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.recordings.units import DEGREES
from drake_cafim.scene.scene import Scene

THOUSAND = 1000.0
TURNS = 0.5 / np.pi
"""In a radian."""
ZEROS = (
    (0.5 * np.pi, "a quarter turn too large"),
    (-0.5 * np.pi, "a quarter turn too small"),
    (np.pi, "half a turn off"),
)
"""Other zeros of a joint's positions, rad."""


def suspicions(scene: Scene, recording: Recording, joints: Sequence[int]) -> Iterator[Suspicion]:
    """Every mistake that is tested in `recording`: of the `joints` by index, and of all joints or a sensor together."""
    names = scene.tree.joint_names
    for j in joints:
        yield from _turned(recording, [names[j]])
        yield from _in_degrees_or_turns(scene, recording, [names[j]])
        yield from _in_thousandths(scene, recording, [names[j]])
        yield from _shifted(scene, recording, names[j])
    if len(names) > 1:
        yield from _turned(recording, names)
        yield from _in_degrees_or_turns(scene, recording, names)
        yield from _in_thousandths(scene, recording, names)
    for a in joints:
        for b in joints:
            if a < b:
                yield from _swapped(recording, names[a], names[b])
    yield from _without_gravity(scene, recording)
    for sensor in scene.wrench_sensors:
        parts = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_COMPONENTS]
        turned = {part: -recording.columns[part] for part in parts}
        yield Suspicion(f"wrench.{sensor.name}", "has its sign turned", turned)


def _turned(recording: Recording, joints: Sequence[str]) -> Iterator[Suspicion]:
    """The sign of u, cmd, v or q is wrong at all of `joints`, or of q and v together."""
    for kinds in (("u",), ("cmd",), ("v",), ("q",), ("q", "v")):
        columns = _columns(recording, kinds, joints)
        if columns:
            turned = {name: -recording.columns[name] for name in columns}
            yield Suspicion(listed(columns), _plural(columns, "its sign turned", "their signs turned"), turned)


def _in_degrees_or_turns(scene: Scene, recording: Recording, joints: Sequence[str]) -> Iterator[Suspicion]:
    """Positions, velocities or both are in degrees, or in turns, at the revolute ones of `joints`."""
    revolute = [name for name in joints if not scene.tree.joints[scene.tree.joint_index(name)].prismatic]
    for unit, scale in (("degrees", DEGREES), ("turns", TURNS)):
        for kinds in ("q", "v", "qv"):
            columns = _columns(recording, kinds, revolute)
            if columns:
                right = {name: recording.columns[name] / scale for name in columns}
                units = {"q": f"{unit}, expected rad", "v": f"{unit}/s, expected rad/s"}.get(
                    kinds, f"{unit} and {unit}/s, expected rad and rad/s"
                )
                words = _plural(columns, f"values in {units}")
                yield Suspicion(listed(columns), words, right, scale, like_physics=scale < 1.0)


def _shifted(scene: Scene, recording: Recording, joint: str) -> Iterator[Suspicion]:
    """Positions of a revolute joint, and its commands, are counted from another zero, a quarter or half a turn away."""
    if scene.tree.joints[scene.tree.joint_index(joint)].prismatic:
        return
    for kinds in (("q",), ("q", "cmd")):
        columns = _columns(recording, kinds, [joint])
        if columns:
            for shift, words in ZEROS:
                right = {name: recording.columns[name] - shift for name in columns}
                yield Suspicion(listed(columns), f"{'is' if len(columns) == 1 else 'are'} {words}", right)


def _in_thousandths(scene: Scene, recording: Recording, joints: Sequence[str]) -> Iterator[Suspicion]:
    """Efforts are in mN m or mN, or the positions, velocities or both of prismatic joints in mm, at all of `joints`."""
    slides = [name for name in joints if scene.tree.joints[scene.tree.joint_index(name)].prismatic]
    efforts = "millinewtons" if len(slides) == len(joints) else "millinewton metres"
    right = {"millinewtons": "N", "millinewton metres": "N m"}[efforts]
    units = {"u": f"{efforts}, expected {right}", "q": "millimetres, expected m", "v": "mm/s, expected m/s"}
    for kinds in ("u", "q", "v", "qv"):
        columns = _columns(recording, kinds, joints if kinds == "u" else slides)
        if columns:
            scaled = {name: recording.columns[name] / THOUSAND for name in columns}
            words = units.get(kinds, "mm and mm/s, expected m and m/s")
            yield Suspicion(listed(columns), _plural(columns, "values in " + words), scaled, THOUSAND)


def _swapped(recording: Recording, a: str, b: str) -> Iterator[Suspicion]:
    """Channels of the joints `a` and `b` are in each other's columns."""
    for kinds in (("u",), ("cmd",), ("q",), ("v",), ("q", "v"), ("q", "v", "u", "cmd")):
        present = [kind for kind in kinds if all(f"{kind}.{name}" in recording.columns for name in (a, b))]
        if len(present) < min(len(kinds), 2):
            continue
        exchanged = {}
        for kind in present:
            exchanged[f"{kind}.{a}"] = recording.columns[f"{kind}.{b}"]
            exchanged[f"{kind}.{b}"] = recording.columns[f"{kind}.{a}"]
        columns = [f"{kind}.{name}" for kind in present for name in (a, b)]
        yield Suspicion(listed(columns), f"have the joints {a} and {b} swapped", exchanged)


def _without_gravity(scene: Scene, recording: Recording) -> Iterator[Suspicion]:
    """The efforts lack those that hold the nominal robot at rest against gravity."""
    names = scene.tree.joint_names
    pushed = {j: f"u.{name}" for j, name in enumerate(names) if f"u.{name}" in recording.columns}
    if not pushed:
        return
    q = np.nan_to_num(recording.matrix("q", names))
    physics = Model(scene.priors.mean).physics(scene)
    holding = bias_force(motion(physics.tree, q, np.zeros_like(q)), physics.gravity)
    whole = {column: recording.columns[column] + holding[:, j] for j, column in pushed.items()}
    yield Suspicion(listed(list(whole)), _plural(list(whole), "gravity already taken out"), whole, like_physics=True)


def in_another_unit(recording: Recording, factors: Mapping[str, float]) -> Suspicion:
    """The efforts at joints are to be multiplied by these `factors`, as found in one recording."""
    right = {f"u.{joint}": factor * recording.columns[f"u.{joint}"] for joint, factor in factors.items()}
    words = _plural(list(right), "values in another unit, expected N m (N)")
    times = listed([rounded(factor, 2) for factor in factors.values()])
    return Suspicion(
        listed(list(right)),
        words,
        right,
        detail=f": multiplied by about {times} they agree with the model, unless its masses are wrong by as much",
    )


def _columns(recording: Recording, kinds: Iterable[str], joints: Sequence[str]) -> list[str]:
    """The columns of all `kinds` at all `joints`; empty where any is missing."""
    wanted = [f"{kind}.{name}" for kind in kinds for name in joints]
    return wanted if all(name in recording.columns for name in wanted) else []


def _plural(columns: Sequence[str], singular: str, more: str | None = None) -> str:
    return f"has {singular}" if len(columns) == 1 else f"have {more or singular}"
