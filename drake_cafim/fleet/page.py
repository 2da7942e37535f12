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
        findings=[_finding(one, fleet, k < MOST_FIGURES) for k, one in enumerate(told)],
        constant=[_row(one) for one in fleet.constant],
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
    told = "; ".join(dict.fromkeys(f"{one.robot}: {_what(one)}" for one in (*fleet.changed, *fleet.unlike)))
    bad = f" {len(fleet.failed)} folder{'s' * (len(fleet.failed) != 1)} could not be used." if fleet.failed else ""
    return f"{size}. {f'{told}.' if told else 'No robot changed, and none is unlike its sisters.'}{bad}"


def _what(one: Followed) -> str:
    """The finding as a clause: what, and since when."""
    trend = one.trend
    head = f"{wording.spoken(one.effect)} at {one.at}"
    if not one.changed:
        return f"{head} unlike its sisters'"
    how = "another one"
    if trend.slope is not None:
        unit = "" if one.unit == "1" else f" {one.unit}"
        how = "growing" if trend.slope[0] > 0.0 else "falling"
        how += f" by {wording.rounded(abs(WEEK * trend.slope[0]), 2)}{unit} a week"
    first, last = (_day(day) for day in trend.since or (0.0, 0.0))
    if trend.course == "line":
        return f"{head} {how}, since before {first}"
    return f"{head} {how} since {last if first == last else f'a time between {first} and {last}'}"


def _finding(one: Followed, fleet: Fleet, drawn: bool) -> dict[str, Any]:
    sisters = [other for other in fleet.followed if other.key == one.key and other.robot != one.robot]
    return {"what": _what(one), "figure": strength_figure(one, sisters) if drawn else None, **_row(one)}


def _row(one: Followed) -> dict[str, Any]:
    unit = "" if one.unit == "1" else one.unit
    slope = one.trend.slope
    return {
        "robot": one.robot,
        "kind": one.kind,
        "effect": wording.spoken(one.effect),
        "at": one.at,
        "parameter": wording.spoken(one.parameter),
        "unit": unit,
        "now": wording.with_interval(*one.trend.now),
        "before": wording.with_interval(*one.trend.before),
        "constant": wording.p_value(one.trend.p_value),
        "drift": None if slope is None else wording.with_interval(WEEK * slope[0], WEEK * slope[1] / wording.INTERVAL),
        "sisters": None if one.sisters is None else wording.with_interval(*one.sisters),
        "unlike": None if one.unlike is None else wording.p_value(one.unlike),
        "named": one.named,
        "recordings": len(one.series),
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
