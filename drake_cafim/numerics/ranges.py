"""Valid ranges of numbers in scenario files: finite, and within bounds."""

import math
from dataclasses import dataclass, field
from typing import Any

from drake_cafim.errors import InputError

LARGEST = 1e12
"""Largest absolute value of any number in SI units: products of a few larger ones could overflow."""


@dataclass(frozen=True)
class Range:
    """The finite numbers from `least` to `most`, in `unit`; with `above`, `least` itself is excluded."""

    least: float = -LARGEST
    most: float = LARGEST
    unit: str = ""
    above: bool = False

    def __contains__(self, value: float) -> bool:
        over = value > self.least if self.above else value >= self.least
        return math.isfinite(value) and over and value <= self.most

    def __str__(self) -> str:
        start, end = ("above", "up to") if self.above else ("from", "to")
        return f"a finite number {start} {self.least:g} {end} {self.words(self.most)}"

    def words(self, value: float) -> str:
        """The value with its unit."""
        return f"{value:g}" if self.unit in ("", "1") else f"{value:g} {self.unit}"

    def check(self, value: float, key: str) -> None:
        """Raises `InputError` for a number outside the range; `key` names the number's file and key."""
        if value not in self:
            raise InputError(f"{key} is {self.words(value)}, expected {self}")


ANY = Range()


def number(default: Any, unit: str = "", least: float = -LARGEST, most: float = LARGEST, *, above: bool = False) -> Any:
    """A dataclass field for a number, or for a list or mapping of numbers, with its range as metadata."""
    metadata = {"range": Range(least, most, unit, above)}
    if callable(default):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)
