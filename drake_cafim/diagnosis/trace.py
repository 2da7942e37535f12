"""The decisions that shaped a verdict, in the order in which they were taken."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

NOMINAL = "the model without effects"
OTHERS = "the others"
"""What a record of a first look calls the effects that it holds together."""


@dataclass(frozen=True)
class Record:
    """One decision: `passed` is what came of comparing the `statistic` with the `threshold`, both in one unit.

    The outcome would have been the other one with the statistic on the other side of the threshold. Where nothing was
    compared both are None. `step` is the kind of decision:

    - `data_mistake`: a mistake of the data, because of which nothing is named;
    - `whiten`: the noise was whitened anew; passed where the unknowns had moved less than asks for another round;
    - `detect`: whether the model without effects differs from the recordings by more than noise (p-value);
    - `screen`: the first look at an effect, to first order; passed where it was then fitted exactly;
    - `another`: whether what is left is worth one more effect; passed where the search went on;
    - `fit`: an explanation that was fitted exactly, against the best one with as many effects;
    - `test`: one of the tests of an admission; `admit`: its outcome, with the test that decided, or was the closest;
    - `choose`: an explanation against the chosen one, by the information criterion;
    - `prune`: whether an effect stays in the chosen explanation;
    - `rival`: an explanation with an effect that the data cannot tell from an accepted one;
    - `adequacy`: whether what is left is as the noise predicts (p-value); `remains`: what of it is the farthest off;
    - `support`: whether an explanation that leaves more than noise takes away more than it leaves;
    - `unknown_forces`, `wider_windows`: further searches, begun, accepted or refused;
    - `verdict`: the kind of the verdict.
    """

    step: str
    asked: str
    """`effect@place`; of several effects joined by " + "; for `remains` the row; for `verdict` its kind."""
    statistic: float | None
    threshold: float | None
    passed: bool
    words: str
    test: str = ""
    """What the statistic is."""
    beside: str = ""
    """The effects that were in the model already, named as in `asked`."""
    search: str = ""
    """Empty for the first search, else what the further one reckoned with."""
    others: tuple[str, ...] = ()
    """Effects that were asked alike, and fared no better than the statistic says."""

    @property
    def effects(self) -> tuple[str, ...]:
        """What was asked about, one `effect@place` each."""
        return tuple(part for part in self.asked.split(" + ") if "@" in part)

    def as_json(self) -> dict[str, Any]:
        """The record as report.json holds it; what is empty is left out, and a number without end is null."""
        told: dict[str, Any] = {
            "step": self.step,
            "asked": self.asked,
            "statistic": _finite(self.statistic),
            "threshold": _finite(self.threshold),
            "passed": self.passed,
            "words": self.words,
        }
        more = {"test": self.test, "beside": self.beside, "search": self.search, "others": list(self.others)}
        return told | {name: value for name, value in more.items() if value}

    @classmethod
    def from_json(cls, told: Mapping[str, Any]) -> "Record":
        """The record that `as_json` told. Raises `KeyError` where one of its six numbers and words is not there."""
        return cls(
            str(told["step"]),
            str(told["asked"]),
            told["statistic"],
            told["threshold"],
            bool(told["passed"]),
            str(told["words"]),
            str(told.get("test", "")),
            str(told.get("beside", "")),
            str(told.get("search", "")),
            tuple(told.get("others", ())),
        )


class Trace:
    """The records of a diagnosis, as they are added; handed from stage to stage."""

    def __init__(self, search: str = "", records: list[Record] | None = None) -> None:
        self.search = search
        self._records: list[Record] = [] if records is None else records

    def add(self, *records: Record) -> None:
        """Append `records`, said to be of this search."""
        self._records.extend(replace(record, search=self.search) for record in records)

    def of_search(self, search: str) -> "Trace":
        """The same trace, for the records of a further search."""
        return Trace(search, self._records)

    @property
    def records(self) -> tuple[Record, ...]:
        """All of them, of every search."""
        return tuple(self._records)


def name_of(key: tuple[str, str]) -> str:
    """`effect@place` of an effect's key."""
    return f"{key[0]}@{key[1]}"


def names_of(keys: Iterable[tuple[str, str]]) -> str:
    """Effects joined by " + ", in alphabetical order; `NOMINAL` where there are none."""
    return " + ".join(sorted(name_of(key) for key in keys)) or NOMINAL


def spoken(asked: str) -> str:
    """What was asked about in words: "joint spring at elbow and payload at link3"."""
    effects = [
        part.replace("@", " at ").replace("_", " ", part.partition("@")[0].count("_")) for part in asked.split(" + ")
    ]
    return " and ".join(effects)


def _finite(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)
