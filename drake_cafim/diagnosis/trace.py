"""The trace of a diagnosis: every decision that shaped the verdict, in the order in which it was taken."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

NOMINAL = "the model without effects"
"""What `Record.asked` says where the decision is about no effect."""
OTHERS = "the others"
"""What `Record.asked` says in a `screen` record that stands for several effects, listed in `Record.others`."""


@dataclass(frozen=True)
class Record:
    """One decision: `passed` is the outcome of comparing `statistic` with `threshold`, both in the same unit.

    With the statistic on the other side of the threshold the outcome would have been the opposite. Both are None where
    nothing was compared. `step` is the kind of decision:

    - `data_mistake`: a mistake of the data, because of which no effect is looked for;
    - `whiten`: the rows were whitened again; passed where the unknowns had moved too little for another round;
    - `servos`: the unknowns of position servos are fitted to simulations, since the equations of motion do not hold,
      and no effect at their joints is found so;
    - `detect`: whether the recordings differ from the model without effects by more than noise (p-value);
    - `screen`: the gain of an effect to first order; passed where it was then fitted exactly;
    - `another`: whether the residual justifies one more effect; passed where the search went on;
    - `fit`: an explanation that was fitted exactly, compared with the best one of as many effects;
    - `test`: one of the tests before an effect is admitted; `admit`: their outcome, with the test that decided it or
      came closest to its threshold;
    - `choose`: an explanation compared with the chosen one by the information criterion;
    - `prune`: whether an effect stays in the chosen explanation;
    - `rival`: an explanation with an effect that the data cannot distinguish from an accepted one;
    - `adequacy`: whether the residual is as the noise predicts (p-value); `remains`: its row that is farthest off;
    - `support`: whether an explanation that leaves more than noise removes more of the misfit than it leaves;
    - `far_unknown`: an unknown parameter too far from its prior, which is a mismatch by itself;
    - `unknown_forces`, `wider_windows`: whether a further search is started, and whether its result is accepted;
    - `correct`: whether a part of what was found goes into the corrected scene, by how well it predicts training parts
      that are left out;
    - `learn`: whether a force without a name at a joint is learned, and stays, by the same measures;
    - `verdict`: the kind of the verdict.
    """

    step: str
    asked: str
    """`effect@place`, several effects joined by " + "; for `remains` the row; for `verdict` its kind."""
    statistic: float | None
    threshold: float | None
    passed: bool
    words: str
    test: str = ""
    """What the statistic is."""
    beside: str = ""
    """The effects that were already in the model, written as in `asked`."""
    search: str = ""
    """Empty for the first search; for a further one, what it allowed for (as unknown forces)."""
    others: tuple[str, ...] = ()
    """Further effects of a `screen` record, whose statistics were no better than this one."""

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of `asked`, as `effect@place` each."""
        return tuple(part for part in self.asked.split(" + ") if "@" in part)

    def as_json(self) -> dict[str, Any]:
        """The record as in report.json: empty optional fields are left out, an infinite or NaN number is null."""
        fields: dict[str, Any] = {
            "step": self.step,
            "asked": self.asked,
            "statistic": _finite(self.statistic),
            "threshold": _finite(self.threshold),
            "passed": self.passed,
            "words": self.words,
        }
        more = {"test": self.test, "beside": self.beside, "search": self.search, "others": list(self.others)}
        return fields | {name: value for name, value in more.items() if value}

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> "Record":
        """The record that `as_json` wrote. Raises `KeyError` where one of the six required fields is missing."""
        return cls(
            str(fields["step"]),
            str(fields["asked"]),
            fields["statistic"],
            fields["threshold"],
            bool(fields["passed"]),
            str(fields["words"]),
            str(fields.get("test", "")),
            str(fields.get("beside", "")),
            str(fields.get("search", "")),
            tuple(fields.get("others", ())),
        )


class Trace:
    """A list of records to which each stage of a diagnosis appends its own."""

    def __init__(self, search: str = "", records: list[Record] | None = None) -> None:
        self.search = search
        self._records: list[Record] = [] if records is None else records

    def add(self, *records: Record) -> None:
        """Appends `records`, marked with this search."""
        self._records.extend(replace(record, search=self.search) for record in records)

    def of_search(self, search: str) -> "Trace":
        """A view of the same list, which marks the records appended through it with another `search`."""
        return Trace(search, self._records)

    @property
    def records(self) -> tuple[Record, ...]:
        """The records of all searches, in order."""
        return tuple(self._records)


def name_of(key: tuple[str, str]) -> str:
    """`effect@place` of an effect's key (name, place)."""
    return f"{key[0]}@{key[1]}"


def names_of(keys: Iterable[tuple[str, str]]) -> str:
    """Effects joined by " + ", in alphabetical order; `NOMINAL` where there are none."""
    return " + ".join(sorted(name_of(key) for key in keys)) or NOMINAL


def spoken(asked: str) -> str:
    """`asked` in words, as "joint spring at elbow and payload at link3"."""
    effects = [
        part.replace("@", " at ").replace("_", " ", part.partition("@")[0].count("_")) for part in asked.split(" + ")
    ]
    return " and ".join(effects)


def _finite(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)
