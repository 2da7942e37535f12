"""The page of a fleet: what changed, in which robot, since when and how fast; which robot is unlike its sisters."""

import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from drake_cafim.fleet.findings import WEEK, Fleet, Followed, date_of, verdicts
from drake_cafim.fleet.strength_figure import strength_figure
from drake_cafim.output import write_text
from drake_cafim.report import colours, wording

TEMPLATE = "fleet.html.j2"
MOST_FIGURES = 24
"""Figures on a page; further findings are rows of a table."""


def write_fleet_page(path: Path, fleet: Fleet, command: Sequence[str]) -> None:
    """Write the page to `path`; `command` is the command line that reproduces it."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    told = [*fleet.changed, *fleet.unlike]
    page = environment.get_template(TEMPLATE).render(
        sentence=sentence_of(fleet),
        accused=fleet.accused,
        findings=[_finding(entry, fleet, k < MOST_FIGURES) for k, entry in enumerate(told)],
        constant=[_row(entry) for entry in fleet.constant],
        seen_once=[(robot, wording.spoken(effect), at, folder) for robot, effect, at, folder in fleet.seen_once],
        failed=fleet.failed,
        robots=[_robot(robot, folders, fleet) for robot, folders in sorted(verdicts(fleet.rows).items())],
        undated=sum(row["time"] is None for row in fleet.rows),
        command=shlex.join(command),
        version=version("drake_cafim"),
        colours=colours,
    )
    write_text(path, page)


def sentence_of(fleet: Fleet) -> str:
    """What the fleet's recordings show, in a sentence or two."""
    robots = {row["robot"] for row in fleet.rows}
    recordings = {(row["robot"], row["recording"]) for row in fleet.rows}
    size = f"{len(robots)} robot{'s' * (len(robots) != 1)}, {len(recordings)} recordings"
    told = "; ".join(dict.fromkeys(f"{entry.robot}: {_what(entry)}" for entry in (*fleet.changed, *fleet.unlike)))
    bad = f" {len(fleet.failed)} folder{'s' * (len(fleet.failed) != 1)} could not be used." if fleet.failed else ""
    return f"{size}. {f'{told}.' if told else 'No robot changed, and none is unlike its sisters.'}{bad}"


def _what(entry: Followed) -> str:
    """The finding as a clause: what, and since when."""
    trend = entry.trend
    head = f"{wording.spoken(entry.effect)} at {entry.at}"
    if not entry.changed:
        return f"{head} unlike its sisters'"
    how = "another one"
    if trend.slope is not None:
        unit = "" if entry.unit == "1" else f" {entry.unit}"
        how = "growing" if trend.slope[0] > 0.0 else "falling"
        how += f" by {wording.rounded(abs(WEEK * trend.slope[0]), 2)}{unit} a week"
    first, last = (_day(day) for day in trend.since or (0.0, 0.0))
    if trend.course == "line":
        return f"{head} {how}, since before {first}"
    return f"{head} {how} since {last if first == last else f'a time between {first} and {last}'}"


def _finding(entry: Followed, fleet: Fleet, drawn: bool) -> dict[str, Any]:
    sisters = [other for other in fleet.followed if other.key == entry.key and other.robot != entry.robot]
    return {"what": _what(entry), "figure": strength_figure(entry, sisters) if drawn else None, **_row(entry)}


def _row(entry: Followed) -> dict[str, Any]:
    unit = "" if entry.unit == "1" else entry.unit
    slope = entry.trend.slope
    return {
        "robot": entry.robot,
        "kind": entry.kind,
        "effect": wording.spoken(entry.effect),
        "at": entry.at,
        "parameter": wording.spoken(entry.parameter),
        "unit": unit,
        "now": wording.with_interval(*entry.trend.now),
        "before": wording.with_interval(*entry.trend.before),
        "constant": wording.p_value(entry.trend.p_value),
        "drift": None if slope is None else wording.with_interval(WEEK * slope[0], WEEK * slope[1] / wording.INTERVAL),
        "sisters": None if entry.sisters is None else wording.with_interval(*entry.sisters),
        "unlike": None if entry.unlike is None else wording.p_value(entry.unlike),
        "named": entry.named,
        "recordings": len(entry.series),
    }


def _robot(robot: str, folders: dict[str, Any], fleet: Fleet) -> dict[str, Any]:
    cells = [
        {
            "folder": name,
            "verdict": row["verdict"],
            "address": None if row["verdict"] == "failed" else f"{name}/report.html",
            "day": "" if row["time"] is None else _day_of(row),
        }
        for name, row in sorted(folders.items(), key=lambda item: (str(item[1]["time"]), item[0]))
    ]
    kinds = sorted({row["kind"].split()[0] for row in folders.values() if row["kind"]})
    return {"robot": robot, "kind": ", ".join(kinds), "cells": cells, "accused": robot in fleet.accused}


def _day(days: float) -> str:
    return date_of(days).strftime("%Y-%m-%d")


def _day_of(row: dict[str, Any]) -> str:
    return str(row["time"].strftime("%Y-%m-%d"))
