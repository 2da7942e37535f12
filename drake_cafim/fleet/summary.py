"""What is kept of each folder of a fleet: its verdict, what was named in it, and the strengths in its recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from drake_cafim.fleet.refit import Refit

Key = tuple[str, str]
"""An effect's name and its place."""


@dataclass(frozen=True)
class Named:
    """An effect that a folder's diagnosis named: its `values` with the shapes of its law, as a scenario states them.

    A `brief` one, as a push, is an event of its recording and has no strength in others.
    """

    effect: str
    at: str
    probability: float
    values: Mapping[str, float]
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By name the value, std and unit as in the report."""
    brief: bool = False

    @property
    def key(self) -> Key:
        return self.effect, self.at


@dataclass(frozen=True)
class Summary:
    """A folder's diagnosis: `verdict` and what was `named`, or the `failure`, one sentence; `kind` is the robot's.

    Robots are of one kind whose model files have one name, and the same joints and bodies.
    """

    folder: str
    verdict: str = ""
    kind: str = ""
    named: tuple[Named, ...] = ()
    failure: str = ""

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "Summary":
        named = tuple(Named(**entry) for entry in raw["named"])
        return cls(raw["folder"], raw["verdict"], raw["kind"], named, raw["failure"])


@dataclass(frozen=True)
class Measured:
    """The strengths in one recording, or the `failure` to fit them; `time` None: unknown."""

    recording: str
    time: datetime | None
    strengths: tuple[Refit, ...] = ()
    failure: str = ""

    def as_json(self) -> dict[str, Any]:
        return {
            "recording": self.recording,
            "time": None if self.time is None else self.time.isoformat(),
            "strengths": [vars(each) for each in self.strengths],
            "failure": self.failure,
        }

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "Measured":
        time = None if raw["time"] is None else datetime.fromisoformat(raw["time"])
        return cls(raw["recording"], time, tuple(Refit(**each) for each in raw["strengths"]), raw["failure"])


def effects_to_follow(
    summaries: Sequence[Summary], robots: Mapping[str, str], groups: Mapping[str, str | None]
) -> dict[str, tuple[Named, ...]]:
    """For each robot, the effects whose strengths are fitted in all of its recordings.

    They are those named in any of its folders, and those named in two folders or more of a robot of its kind: so that
    the strength is known before it was named, and in the sisters. Of alternative laws of one phenomenon at one place
    (`groups`, by effect), the one that most folders name. `robots` is the robot of each folder.
    """
    by_robot: dict[str, list[Summary]] = {}
    for summary in summaries:
        by_robot.setdefault(robots[summary.folder], []).append(summary)
    followed = {}
    for robot, own in by_robot.items():
        kinds = {each.kind for each in own if each.kind}
        sisters = [other for name, others in by_robot.items() if name != robot for other in others]
        entries = _namings(own)
        for key, found in _namings_twice(sisters, kinds, robots).items():
            entries.setdefault(key, []).extend(found)
        followed[robot] = _without_alternatives(entries, groups)
    return followed


def _namings(summaries: Sequence[Summary]) -> dict[Key, list[Named]]:
    found: dict[Key, list[Named]] = {}
    for summary in summaries:
        for named in summary.named:
            if not named.brief:
                found.setdefault(named.key, []).append(named)
    return found


def _namings_twice(sisters: Sequence[Summary], kinds: set[str], robots: Mapping[str, str]) -> dict[Key, list[Named]]:
    """Namings of effects that two folders or more of one and the same sister name."""
    by_robot: dict[str, list[Summary]] = {}
    for summary in sisters:
        if summary.kind in kinds:
            by_robot.setdefault(robots[summary.folder], []).append(summary)
    found: dict[Key, list[Named]] = {}
    for own in by_robot.values():
        for key, namings in _namings(own).items():
            if len(namings) > 1:
                found.setdefault(key, []).extend(namings)
    return found


def _without_alternatives(
    entries: Mapping[Key, Sequence[Named]], groups: Mapping[str, str | None]
) -> tuple[Named, ...]:
    """The surest naming of each effect; of those of one group at one place, the effect that was named most often."""
    kept: dict[tuple[str, str], Key] = {}
    for key, _ in sorted(entries.items(), key=lambda item: (-len(item[1]), item[0])):
        kept.setdefault((groups.get(key[0]) or key[0], key[1]), key)
    chosen = sorted(kept.values())
    return tuple(max(entries[key], key=lambda each: (each.probability, sorted(each.values.items()))) for key in chosen)
