"""The findings of a study: tables, figures and claims, and the statistics that decide a claim's standing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from drake_cafim.numerics.rounding import short
from drake_cafim.studies.cell import Cell
from drake_cafim.typing import Array

Standing: TypeAlias = Literal["holds", "ties", "does not hold", "cannot be repeated here"]


@dataclass(frozen=True)
class Claim:
    """A claim or requirement, the result found for it, and whether it holds."""

    claim: str
    found: str
    standing: Standing


@dataclass(frozen=True)
class Table:
    """A titled table of words."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Findings:
    """All that a study's page shows; figures are SVG elements."""

    title: str
    about: str
    claims: tuple[Claim, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[str, ...] = field(default=(), repr=False)


def require(claim: str, value: float, bound: float, *, at_most: bool = False, digits: int = 2) -> Claim:
    """A claim that a number is at least (at most) `bound`."""
    holds = value <= bound if at_most else value >= bound
    word = "at most" if at_most else "at least"
    return Claim(f"{claim}: {word} {bound:g}", f"{value:.{digits}f}", "holds" if holds else "does not hold")


@dataclass(frozen=True)
class Ratio:
    """A ratio of medians with its 95 % bootstrap interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        value, low, high = (short(part, 3) for part in (self.value, self.low, self.high))
        return f"{value} ({low}–{high})"

    @property
    def alike(self) -> bool:
        """Whether the ratio is between 0.8 and 1.25."""
        return 0.8 <= self.value <= 1.25

    @property
    def standing(self) -> Standing:
        """`ties` between 0.8 and 1.25 or where the interval contains 1; else `holds` where the first is larger."""
        if self.alike or self.low <= 1.0 <= self.high:
            return "ties"
        return "holds" if self.value > 1.25 else "does not hold"


def ratio_of_medians(first: Sequence[float], second: Sequence[float], draws: int = 2000) -> Ratio:
    """Median of `first` over median of `second`, with its 95 % interval by bootstrap with a fixed seed."""
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    random = np.random.default_rng(0)
    above = np.median(random.choice(a, (draws, len(a))), axis=1)
    below = np.median(random.choice(b, (draws, len(b))), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(above / below, nan=1.0, posinf=np.inf)
        value = float(np.nan_to_num(np.median(a) / np.median(b), nan=1.0, posinf=np.inf))
    low, high = np.quantile(ratios, [0.025, 0.975], method="nearest")
    return Ratio(value, float(low), float(high))


def final_errors(results: Sequence[dict[str, Any]]) -> Array:
    """|error| in percent after the last experiment, (runs, n)."""
    return np.asarray(np.abs(np.array([result["experiments"][-1]["error"] for result in results], dtype=float)))


def information(results: Sequence[dict[str, Any]]) -> list[float]:
    """Scaled trace of an experiment's Fisher information, its mean over each run's experiments."""
    return [float(np.mean([experiment["information"] for experiment in result["experiments"]])) for result in results]


def behaviours(results: Sequence[dict[str, Any]], name: str) -> list[Any]:
    """The behaviour `name` of each experiment of each run."""
    return [experiment["behaviour"][name] for result in results for experiment in result["experiments"]]


def world_name(results: Mapping[Cell, Any]) -> str:
    """The world of the runs in words: the kinematic one, or `model`."""
    if any(cell.world == "model" for cell in results):
        return "world `model`: robots in Drake, pushed by the planner's own law"
    return "the kinematic world, where commands are tracked perfectly"
