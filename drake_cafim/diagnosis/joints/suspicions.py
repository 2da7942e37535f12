"""What may be wrong with a recording's columns, and the columns put right."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.dynamics.motion import bias_force, motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.recordings.units import DEGREES
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Suspicion:
    """A mistake that `subject` may hold, as "u.elbow", in words: `predicate`; and its columns put right.

    A mistake that `scales` the motion down when it is put right is believed only where nothing but noise is left then,
    and where the motion scaled down once more leaves far more: a motion 57 times as small suits any model that asks for
    too much effort better, and one that is almost none asks for none.
    """

    subject: str
    predicate: str
    columns: Mapping[str, Array]
    scales: bool = False

    @property
    def key(self) -> tuple[str, str]:
        """The same for the same mistake of another recording."""
        return self.subject, self.predicate

    def put_right(self, recording: Recording) -> Recording:
        """`recording` with the suspected columns replaced."""
        return replace(recording, columns={**recording.columns, **self.columns})

    def scaled_again(self, recording: Recording) -> Recording:
        """`recording`, in which this is put right, with the suspected columns divided by 180/π once more."""
        again = {name: recording.columns[name] / DEGREES for name in self.columns}
        return replace(recording, columns={**recording.columns, **again})


def suspicions(scene: Scene, recording: Recording, joints: Sequence[int]) -> Iterator[Suspicion]:
    """Every mistake that is looked for in `recording`, of the `joints` by index and of what joints share."""
    names = scene.tree.joint_names
    for j in joints:
        yield from _turned(recording, [names[j]])
        yield from _in_degrees(scene, recording, [names[j]])
    if len(names) > 1:
        yield from _turned(recording, names)
        yield from _in_degrees(scene, recording, names)
    for a in joints:
        for b in joints:
            if a < b:
                yield from _swapped(recording, names[a], names[b])
    yield _without_gravity(scene, recording)
    for sensor in scene.wrench_sensors:
        parts = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_COMPONENTS]
        turned = {part: -recording.columns[part] for part in parts}
        yield Suspicion(f"wrench.{sensor.name}", "has its sign turned", turned)


def _turned(recording: Recording, joints: Sequence[str]) -> Iterator[Suspicion]:
    """The sign of one kind of channel at all of `joints` is turned, or of q and v together."""
    for kinds in ("u", "v", "q", "qv"):
        columns = _columns(recording, kinds, joints)
        if columns:
            turned = {name: -recording.columns[name] for name in columns}
            yield Suspicion(_listed(columns), _plural(columns, "its sign turned", "their signs turned"), turned)


def _in_degrees(scene: Scene, recording: Recording, joints: Sequence[str]) -> Iterator[Suspicion]:
    """Positions, velocities or both of the revolute ones among `joints` are in degrees."""
    revolute = [name for name in joints if not scene.tree.joints[scene.tree.joint_index(name)].prismatic]
    for kinds in ("q", "v", "qv"):
        columns = _columns(recording, kinds, revolute)
        if columns:
            right = {name: recording.columns[name] / DEGREES for name in columns}
            units = {"q": "degrees, expected rad", "v": "degrees/s, expected rad/s"}.get(
                kinds, "degrees and degrees/s, expected rad and rad/s"
            )
            yield Suspicion(_listed(columns), _plural(columns, "values in " + units), right, scales=True)


def _swapped(recording: Recording, a: str, b: str) -> Iterator[Suspicion]:
    """Channels of the joints `a` and `b` stand in each other's columns."""
    for kinds in ("u", "qv", "qvu"):
        present = [kind for kind in kinds if f"{kind}.{a}" in recording.columns]
        exchanged = {}
        for kind in present:
            exchanged[f"{kind}.{a}"] = recording.columns[f"{kind}.{b}"]
            exchanged[f"{kind}.{b}"] = recording.columns[f"{kind}.{a}"]
        columns = [f"{kind}.{name}" for kind in present for name in (a, b)]
        yield Suspicion(_listed(columns), f"have the joints {a} and {b} swapped", exchanged)


def _without_gravity(scene: Scene, recording: Recording) -> Suspicion:
    """The efforts lack what holds the nominal robot still against gravity."""
    names = scene.tree.joint_names
    q = np.nan_to_num(recording.matrix("q", names))
    physics = Model(scene.priors.mean).physics(scene)
    holding = bias_force(motion(physics.tree, q, np.zeros_like(q)), physics.gravity)
    whole = {f"u.{name}": recording.columns[f"u.{name}"] + holding[:, j] for j, name in enumerate(names)}
    return Suspicion(_listed(list(whole)), _plural(list(whole), "gravity already taken out"), whole)


def _columns(recording: Recording, kinds: str, joints: Sequence[str]) -> list[str]:
    """The columns of all `kinds` at all `joints`; none where one of them is missing."""
    wanted = [f"{kind}.{name}" for kind in kinds for name in joints]
    return wanted if all(name in recording.columns for name in wanted) else []


def _plural(columns: Sequence[str], one: str, more: str | None = None) -> str:
    return f"has {one}" if len(columns) == 1 else f"have {more or one}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
