"""Of cases with many effects at once: figures effect by effect."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

Scores = Sequence[dict[str, Any]]
SIGMAS = (0.0, 3.0, 10.0, 30.0, 100.0, np.inf)


def of_many(scores: Scores) -> list[dict[str, Any]]:
    return [item for item in scores if item["kind"] == "many"]


def shares(scores: Scores) -> dict[str, tuple[float | None, int]]:
    """Share and number: of clear effects that are named, of names that are false, of intervals that hold the truth."""
    many = of_many(scores)
    lists = {
        "named": [
            there for item in many for there, sure in zip(item["found"], item["clear_effects"], strict=True) if sure
        ],
        "false": [name in item["wrong_names"] for item in many for name in item["named"]],
        "covered": [entry[1] for item in many for entry in item["covered"]],
    }
    return {name: (float(np.mean(values)) if values else None, len(values)) for name, values in lists.items()}


def by_effect(scores: Scores) -> list[dict[str, Any]]:
    """A row an effect: how often it is there, clear, and named where it is, and how often its name is false."""
    counts: dict[str, dict[str, int]] = {}

    def row(name: str) -> dict[str, int]:
        return counts.setdefault(name, dict.fromkeys(("there", "clear_count", "named", "false"), 0))

    for item in of_many(scores):
        for (name, _), there, sure in zip(item["truth"], item["found"], item["clear_effects"], strict=True):
            row(name)["there"] += 1
            row(name)["clear_count"] += sure
            row(name)["named"] += sure and there
        for name, _ in item["wrong_names"]:
            row(name)["false"] += 1
    return [{"name": name, **counts[name]} for name in sorted(counts)]


def by_sigma(scores: Scores) -> list[dict[str, Any]]:
    """A row a range of sigma: effects there and named."""
    each = [pair for item in of_many(scores) for pair in zip(item["strengths"], item["found"], strict=True)]
    rows = []
    for low, high in pairwise(SIGMAS):
        found = [there for sigma, there in each if low <= sigma < high]
        name = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
        rows.append({"name": name, "there": len(found), "named": sum(found)})
    return rows
