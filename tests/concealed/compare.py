"""Two scorings of the same cases side by side: each figure before and after, and the cases whose outcome changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment

from .summary import Figure, figures

Scores = Sequence[dict[str, Any]]


@dataclass(frozen=True)
class Line:
    """A figure before and after; counts may differ where they are of named strengths."""

    name: str
    before: float | None
    after: float | None
    count_before: int
    count: int
    limit: str
    mark: str

    def text(self) -> str:
        """One line of the table that is printed."""
        found = f"{shown(self.before):>6} → {shown(self.after):<6}"
        return f"{found} {self.limit:>10} {self.mark:>16}  {self.name} ({self.counts()})"

    def counts(self) -> str:
        return f"{self.count}" if self.count == self.count_before else f"{self.count_before} → {self.count}"


def shown(value: float | None) -> str:
    """Three decimals, or a dash where there was nothing to count."""
    return "–" if value is None else f"{value:.3f}"


def comparison(before: Scores, after: Scores) -> list[Line]:
    """The proof's figures of both scorings."""
    pairs: Sequence[tuple[Figure, Figure]] = list(zip(figures(before), figures(after), strict=True))
    return [Line(new.name, old.value, new.value, old.count, new.count, new.limit, new.mark) for old, new in pairs]


@dataclass(frozen=True)
class Change:
    """A case that is told of otherwise; `kind` is better, worse or other."""

    kind: str
    name: str
    slot: int
    rig: str
    truth: str
    before: str
    after: str

    def text(self) -> str:
        return f"{self.kind:>6}: {self.name} (slot {self.slot}, {self.rig}) {self.truth}: {self.before} → {self.after}"


def grade(item: dict[str, Any]) -> int:
    """How good an outcome is.

    3: right. 2: not right, but `unexplained` and no name wrong. 1: no name wrong, but the verdict says that nothing
    more is there. 0: a wrong name, or no verdict.
    """
    if item["right"]:
        return 3
    if item["verdict"] == "failed" or item["wrong_names"]:
        return 0
    return 2 if item["verdict"] == "unexplained" else 1


def outcome(item: dict[str, Any]) -> tuple[str, tuple[tuple[str, ...], ...]]:
    """Verdict and names, in no order."""
    return item["verdict"], tuple(sorted(tuple(name) for name in item["named"]))


def told(item: dict[str, Any]) -> str:
    """The outcome in words, and why there is none."""
    names = "; ".join(f"{name} at {at}" for name, at in item["named"])
    said = f"{item['verdict']}{': ' + names if names else ''}"
    return f"{said} ({item['failure'][:120]})" if item["failure"] else said


def changes(before: Scores, after: Scores) -> list[Change]:
    """The cases whose outcome changed: worse ones first, then better ones, then those as good as they were."""
    earlier = {item["name"]: item for item in before}
    found = []
    for item in after:
        old = earlier[item["name"]]
        if outcome(old) == outcome(item) and old["right"] == item["right"]:
            continue
        rise = grade(item) - grade(old)
        kind = "better" if rise > 0 else "worse" if rise < 0 else "other"
        true = "; ".join(f"{name} at {at}" for name, at in item["truth"]) or "nothing concealed"
        found.append(Change(kind, item["name"], item["slot"], item["rig"], true, told(old), told(item)))
    return sorted(found, key=lambda change: (("worse", "better", "other").index(change.kind), change.slot))


def write_comparison(
    path: Path, about: dict[str, Any], lines: Sequence[Line], found: Sequence[Change], count: int
) -> None:
    """Writes the page at once, never half of it."""
    template = Environment(autoescape=True).from_string((Path(__file__).parent / "comparison.html").read_text())
    counts = {kind: sum(change.kind == kind for change in found) for kind in ("worse", "better", "other")}
    text = template.render(about=about, lines=lines, changes=found, counts=counts, count=count, shown=shown)
    temporary = path.with_suffix(".part")
    temporary.write_text(text)
    temporary.replace(path)
