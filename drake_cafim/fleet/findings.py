"""What the table of a fleet shows: which strength of which robot changed, and which robot is unlike its sisters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.effect import Strength
from drake_cafim.fleet.table import FAILED, Row
from drake_cafim.fleet.trend import Series, Trend, trend_of

FALSE_ALARMS = 0.01
"""Expected number of strengths per fleet that are told to have changed, to be unlike the sisters', or to be there, by
chance."""
SISTERS = 2
"""Fewest sisters with which a robot is compared."""
WEEK = 7.0
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class Followed:
    """One strength of one robot over its recordings: `series` in days since 1970, its `trend`, and what it implies.

    - `present`: p-value of the hypothesis that the effect is absent throughout, times the strengths tested.
    - `unlike`: p-value of the hypothesis that its level is one of its sisters', times the strengths tested; None
      without sisters. `sisters`: their mean level and the std among them.
    - `named`: in how many of the robot's folders the effect was named.
    """

    robot: str
    kind: str
    effect: str
    at: str
    parameter: str
    unit: str
    series: Series
    trend: Trend
    nominal: float
    present: float
    unlike: float | None
    sisters: tuple[float, float] | None
    named: int

    @property
    def changed(self) -> bool:
        return self.trend.p_value < FALSE_ALARMS

    @property
    def stands_out(self) -> bool:
        return self.unlike is not None and self.unlike < FALSE_ALARMS

    @property
    def size(self) -> float:
        """The change from the first recording to the last, in stds of it."""
        return abs(self.trend.now[0] - self.trend.before[0]) / float(np.hypot(self.trend.now[1], self.trend.before[1]))

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.kind, self.effect, self.at, self.parameter


@dataclass(frozen=True)
class Fleet:
    """All that the fleet's page tells, the largest change first.

    `shared` are effects that every robot of a kind has alike: those are missing in the model and not in a robot.
    `seen_once` are (robot, effect, place, folder) of namings that the strengths over time do not bear out.
    """

    followed: tuple[Followed, ...]
    rows: tuple[Row, ...]
    seen_once: tuple[tuple[str, str, str, str], ...]

    @property
    def changed(self) -> list[Followed]:
        return sorted(
            (item for item in self.followed if item.changed), key=lambda item: (-item.size, item.robot, item.key)
        )

    @property
    def unlike(self) -> list[Followed]:
        """Those that do not change, but have been unlike their sisters all the time."""
        found = [item for item in self.followed if item.stands_out and not item.changed]
        return sorted(found, key=lambda item: (item.unlike, item.robot, item.key))

    @property
    def constant(self) -> list[Followed]:
        """Those that are there without a change, in a robot without sisters or as in its sisters."""
        told = {(item.robot, *item.key) for item in (*self.changed, *self.unlike)}
        found = [item for item in self.followed if item.present < FALSE_ALARMS and (item.robot, *item.key) not in told]
        return sorted(found, key=lambda item: (item.key, item.robot))

    @property
    def accused(self) -> list[str]:
        """The robots that changed or are unlike their sisters."""
        return sorted({item.robot for item in (*self.changed, *self.unlike)})

    @property
    def failed(self) -> list[Row]:
        return [row for row in self.rows if row["verdict"] == FAILED]


def findings_of(rows: Sequence[Row]) -> Fleet:
    """The findings in the rows of a fleet's table."""
    gathered: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row["strength"] is not None and row["std"] and row["time"] is not None and not row["why"]:
            strength = _strength(row["effect"], row["parameter"])
            if strength is None or (strength.amplitude and not strength.through):
                key = tuple(row[name] for name in ("robot", "kind", "effect", "place", "parameter"))
                gathered.setdefault(key, []).append(row)
    tested = len(gathered)
    series = {key: _series(found) for key, found in gathered.items()}
    trends = {key: trend_of(item, tested) for key, item in series.items()}
    followed = []
    for key, trend in trends.items():
        robot, kind, effect, at, parameter = key
        others = [trends[other].now for other in trends if other[1:] == key[1:] and other != key]
        strength = _strength(effect, parameter)
        nominal = 0.0 if strength is None else strength.nominal
        away = float(np.max([abs(level - nominal) / std for level, std in (trend.before, trend.now)]))
        named = {row["folder"] for row in gathered[key] if row["probability"] is not None}
        followed.append(
            Followed(
                robot, kind, effect, at, parameter, str(gathered[key][0]["unit"]), series[key], trend, nominal,
                min(1.0, 2.0 * float(norm.sf(away)) * tested), *_among(trend.now, others, tested), len(named),
            )
        )  # fmt: skip
    return Fleet(tuple(followed), tuple(rows), _seen_once(rows, followed))


def _among(
    own: tuple[float, float], others: Sequence[tuple[float, float]], tested: int
) -> tuple[float | None, tuple[float, float] | None]:
    """The p-value that a level is one of the others', by Student's t, and their mean and std."""
    if len(others) < SISTERS:
        return None, None
    levels, stds = np.array(others).T
    spread = float(np.hypot(np.std(levels, ddof=1), np.sqrt(np.mean(stds**2))))
    mean = float(np.mean(levels))
    away = abs(own[0] - mean) / float(np.sqrt(own[1] ** 2 + spread**2 * (1.0 + 1.0 / len(levels))))
    return min(1.0, 2.0 * float(student.sf(away, len(levels) - 1)) * tested), (mean, float(np.std(levels, ddof=1)))


def _series(rows: Sequence[Row]) -> Series:
    ordered = sorted(rows, key=lambda row: (row["time"], row["recording"]))
    days = [(row["time"] - _EPOCH).total_seconds() / 86400.0 for row in ordered]
    return Series(np.array(days), *(np.array([float(row[name]) for row in ordered]) for name in ("strength", "std")))


def _seen_once(rows: Sequence[Row], followed: Sequence[Followed]) -> tuple[tuple[str, str, str, str], ...]:
    """Namings at a robot's place that are no finding: the strength neither changed, nor stands out, nor is there."""
    borne = {(o.robot, o.effect, o.at) for o in followed if o.changed or o.stands_out or o.present < FALSE_ALARMS}
    namings = {
        (row["robot"], row["effect"], row["place"], row["folder"]) for row in rows if row["probability"] is not None
    }
    return tuple(sorted(item for item in namings if item[:3] not in borne))


def _strength(effect: str, parameter: str) -> Strength | None:
    """The catalogue's entry; None for an effect of the user's own."""
    for kind in EFFECTS:
        for strength in kind.strengths if kind.name == effect else ():
            if strength.name == parameter:
                return strength
    return None


def date_of(days: float) -> datetime:
    """The time of `days` since 1970."""
    return _EPOCH + timedelta(days=days)


def verdicts(rows: Sequence[Row]) -> Mapping[str, dict[str, Row]]:
    """By robot, the first row of each of its folders."""
    found: dict[str, dict[str, Row]] = {}
    for row in rows:
        found.setdefault(row["robot"], {}).setdefault(row["folder"], row)
    return found
