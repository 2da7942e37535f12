"""Summary figures over all scored cases, each with its limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .summary_many import shares

Scores = Sequence[dict[str, Any]]

BEFORE = "as counted in 0.1.0"
"""Said of figures in which a wrong name beside `unexplained`, or noise told of beside an alarm, is forgiven."""


@dataclass(frozen=True)
class Figure:
    """A figure, the number of cases it stands on, its limit and whether it is kept; value None: nothing to count."""

    name: str
    value: float | None
    count: int
    limit: str
    kept: bool | None

    @property
    def mark(self) -> str:
        """What is said of it."""
        if self.kept is None:
            return "nothing to count" if self.value is None else "no limit"
        return "kept" if self.kept else "missed"


def part(scores: Scores, key: str | Callable[[dict[str, Any]], bool]) -> float | None:
    if not scores:
        return None
    return float(np.mean([bool(key(item) if callable(key) else item.get(key, False)) for item in scores]))


def _at_least(name: str, value: float | None, count: int, limit: float) -> Figure:
    return Figure(name, value, count, f"≥ {limit:g}", None if value is None else value >= limit)


def _at_most(name: str, value: float | None, count: int, limit: float) -> Figure:
    return Figure(name, value, count, f"≤ {limit:g}", None if value is None else value <= limit)


def _interval(name: str, covered: Sequence[bool]) -> Figure:
    value = float(np.mean(covered)) if covered else None
    return Figure(name, value, len(covered), "0.92–0.97", None if value is None else 0.92 <= value <= 0.97)


def figures(scores: Scores) -> list[Figure]:
    """The proof's table."""
    single = [item for item in scores if item["kind"] == "single"]
    clear = [item for item in single if item["clear"]]
    seen = [item for item in single if item.get("sigmas") and item["sigmas"][0] >= CLEAR_SIGMA]
    nulls = [item for item in scores if item["kind"] == "null"]
    odd = [item for item in scores if item["kind"] == "odd" and item["clear"]]
    pairs = [item for item in scores if item["kind"] == "pair" and item["clear"]]
    alone = [item["transient"] for item in clear if item.get("transient")]
    pulses = alone + [item["transient"] for item in pairs if item.get("transient")]
    errors = [error for item in clear for error in item.get("errors", [])]
    held = held_out_gains(scores)
    true = [item for item in scores if item["kind"] in ("single", "pair")]
    covered = [entry[1] for item in true for entry in item.get("covered", [])]
    unnamed = [entry[1] for item in true for entry in item.get("covered_unnamed", [])]
    # strengths are drawn from invisible on: what is too faint is left out rather than called by another name
    renamed = part(true, lambda item: item.get("second_name", False) and len(item["named"]) >= len(item["truth"]))
    left_out = part(true, lambda item: item.get("second_name", False) and len(item["named"]) < len(item["truth"]))
    second_answers = part(true, lambda item: item.get("second_name", False))
    many = shares(scores)
    alone_or_none = [item for item in scores if item["kind"] != "many"]
    alarms = part(nulls, lambda item: not item["right"])
    alarms_before = part(nulls, lambda item: not item["right_as_before"])
    return [
        _at_least("clear single effects: exact name and place", part(clear, "right"), len(clear), 0.90),
        _at_least("clear single effects: family", part(clear, "family"), len(clear), 0.96),
        _at_least("clear single effects: place", part(clear, "place"), len(clear), 0.96),
        _at_most("clear single effects that end unexplained", part(clear, "ended_unexplained"), len(clear), 0.05),
        _at_least(
            f"single effects of {CLEAR_SIGMA:g} sigma or more beside the nearest rival: named right",
            part(seen, "right"),
            len(seen),
            0.95,
        ),
        _at_most(
            "of these: a wrong name, under any verdict", part(seen, lambda i: end_of(i) == "misnamed"), len(seen), 0.03
        ),
        _at_least("clear pairs: both right", part(pairs, "right"), len(pairs), 0.75),
        _at_most("nulls: false alarms", alarms, len(nulls), 0.02),
        Figure(f"nulls: false alarms, {BEFORE}", alarms_before, len(nulls), "–", None),
        _at_least("clear, outside the vocabulary: called unexplained", part(odd, "right"), len(odd), 0.90),
        Figure(
            f"clear, outside the vocabulary: called unexplained, {BEFORE}",
            part(odd, "right_as_before"),
            len(odd),
            "–",
            None,
        ),
        _at_most("clear, outside the vocabulary: misnamed", part(odd, "misnamed"), len(odd), 0.05),
        Figure(
            f"clear, outside the vocabulary: misnamed, {BEFORE}", part(odd, "misnamed_as_before"), len(odd), "–", None
        ),
        _at_least("clear pulses: centre within 50 ms and overlap ≥ 0.7", part(pulses, _located), len(pulses), 0.90),
        Figure("of these, single effects", part(alone, _located), len(alone), "–", None),
        _at_most(
            "clear: median relative error of the strength",
            float(np.median(errors)) if errors else None,
            len(errors),
            0.05,
        ),
        _interval("95 % intervals of named strengths that hold the truth", covered),
        _interval("95 % intervals of all true strengths, named or not, that hold it", covered + unnamed),
        _at_least(
            "explained: held-out likelihood better",
            part(held, lambda gain: gain > 0.0) if held else None,
            len(held),
            0.98,
        ),  # type: ignore[arg-type]
        _at_most("single effects and pairs right only by a sealed second answer", second_answers, len(true), 0.10),
        Figure("of these, by another effect's name", renamed, len(true), "–", None),
        Figure(
            "of these, too faint to be seen by the maker's reckoning, and not named", left_out, len(true), "–", None
        ),
        Figure(
            "all of these kinds: a wrong name in the explanation",
            part(alone_or_none, "wrong_names"),
            len(alone_or_none),
            "–",
            None,
        ),
        _at_least("many effects at once: clear ones named", *many["named"], 0.90),
        _at_most("many effects at once: names that are false", *many["false"], 0.05),
        Figure("many effects at once: 95 % intervals that hold the truth", *many["covered"], "–", None),
        _at_most(
            "diagnoses that failed or timed out",
            part(scores, lambda item: item["verdict"] == "failed"),
            len(scores),
            0.0,
        ),
    ]


def _located(pulse: dict[str, float]) -> bool:
    return pulse["centre_error"] <= 0.05 and pulse["overlap"] >= 0.7


def held_out_gains(scores: Scores) -> list[float]:
    """ln likelihood a sample that the effects gain on the run held out, of single effects that were explained."""
    single = [item for item in scores if item["kind"] == "single" and item["verdict"] == "explained"]
    return [float(item["held_out_gain"]) for item in single if item.get("held_out_gain") is not None]


SIGMAS = (0.0, 1.0, 2.0, 4.0, 7.0, 10.0, 20.0, 50.0, 100.0, 300.0, 1000.0, np.inf)
"""Ranges of sigma of which the shares are told."""
CLEAR_SIGMA = 10.0


def end_of(item: dict[str, Any]) -> str:
    """How the diagnosis of a single effect ended: named, misnamed, unexplained or nothing."""
    if item["right"]:
        return "named"
    if item["wrong_names"]:
        return "misnamed"
    return "unexplained" if item["verdict"] == "unexplained" else "nothing"


def curve(scores: Scores, edges: Sequence[float] = SIGMAS) -> list[dict[str, Any]]:
    """Of single effects: shares that end in each way, by sigma beside the nearest rival."""
    single = [item for item in scores if item["kind"] == "single" and item.get("sigmas")]
    out = []
    for low, high in pairwise(edges):
        inside = [end_of(item) for item in single if low <= item["sigmas"][0] < high]
        if inside:
            ends = ("named", "misnamed", "unexplained", "nothing")
            shares = {end: inside.count(end) / len(inside) for end in ends}
            out.append({"low": low, "high": high, "count": len(inside), **shares})
    return out


def confusion(scores: Scores, clear_only: bool = False) -> tuple[list[str], list[str], dict[tuple[str, str], int]]:
    """True names (rows), told names (columns) and counts; cases of several effects are left out."""
    counts: dict[tuple[str, str], int] = {}
    for item in scores:
        if item["kind"] in ("pair", "many") or (clear_only and item["kind"] != "null" and not item["clear"]):
            continue
        true = item["truth"][0][0] if item["truth"] else "none"
        told = (
            " + ".join(sorted({name for name, _ in item["named"]}))
            if item["verdict"] == "explained"
            else item["verdict"]
        )
        told = told if " + " not in told else "several"
        counts[true, told] = counts.get((true, told), 0) + 1
    rows = sorted({true for true, _ in counts}, key=lambda name: (name == "none", name.startswith("odd_"), name))
    last = ("several", "unexplained", "none", "failed")
    columns = sorted({told for _, told in counts}, key=lambda name: (last.index(name) + 1 if name in last else 0, name))
    return rows, columns, counts


def calibration(scores: Scores) -> list[dict[str, float]]:
    """Nominal against actual coverage of central intervals of the named strengths."""
    z = np.array(
        [entry[2] for item in scores if item["kind"] in ("single", "pair") for entry in item.get("covered", [])]
    )
    if len(z) == 0:
        return []
    from scipy.stats import norm

    levels = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)
    return [
        {"level": level, "actual": float(np.mean(np.abs(z) <= norm.ppf(0.5 + 0.5 * level))), "count": float(len(z))}
        for level in levels
    ]
