"""proof.html from the scored trials."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jinja2 import Environment
from matplotlib.figure import Figure

from .summary import CLEAR_SIGMA, calibration, confusion, curve, figures, held_out_gains, part
from .summary_many import by_effect, by_sigma
from .truth import FAMILY

Scores = Sequence[dict[str, Any]]
_FAMILY_COLOUR = {"right": "#1b7f4b", "wrong": "#c4453c"}


def _svg(figure: Figure) -> str:
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "proof"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


ENDS = {"named": "#17743b", "misnamed": "#c4453c", "unexplained": "#c9a227", "nothing": "#8a97a5"}
"""How a diagnosis of a single effect may end, and the colour of each."""


def curve_svg(scores: Scores) -> str:
    """Shares of single effects that end in each way against sigma."""
    points = curve(scores)
    figure = Figure(figsize=(8.6, 3.9), layout="constrained")
    axes = figure.add_subplot()
    middle = [float(np.sqrt(max(p["low"], 0.5) * min(p["high"], 5e3))) for p in points]
    for end, colour in ENDS.items():
        axes.plot(middle, [p[end] for p in points], "o-", color=colour, label=end, markersize=4)
    for x, p in zip(middle, points, strict=True):
        axes.annotate(f"{p['count']}", (x, -0.07), ha="center", fontsize=8, color="#53626f", annotation_clip=False)
    axes.axvline(CLEAR_SIGMA, color="#53626f", linestyle="--", linewidth=1)
    axes.set(
        xscale="log",
        xlim=(0.4, 4e3),
        ylim=(-0.12, 1.05),
        xlabel="sigma beside the nearest rival, and below the number of cases",
        ylabel="share of single effects",
    )
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.spines[["top", "right"]].set_visible(False)
    return _svg(figure)


def calibration_svg(scores: Scores) -> str:
    """Actual against nominal coverage of the named strengths' intervals."""
    points = calibration(scores)
    figure = Figure(figsize=(4.2, 3.9), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="#c7d0d9", linewidth=1)
    if points:
        axes.plot([p["level"] for p in points], [p["actual"] for p in points], "o-", color="#2b6cb0", markersize=4)
        axes.set_title(f"{int(points[0]['count'])} parameters of named effects", fontsize=9)
    axes.set(xlabel="interval's level", ylabel="holds the truth", xlim=(0.4, 1.02), ylim=(0.0, 1.02))
    axes.spines[["top", "right"]].set_visible(False)
    return _svg(figure)


def _matrix(scores: Scores, title: str, clear_only: bool) -> dict[str, Any]:
    rows, columns, counts = confusion(scores, clear_only)
    table = []
    for true in rows:
        total = sum(counts.get((true, told), 0) for told in columns)
        cells = []
        for told in columns:
            count = counts.get((true, told), 0)
            good = told == true or (true.startswith("odd_") and told == "unexplained")
            share = count / max(total, 1)
            base = (27, 127, 75) if good else (196, 69, 60)
            colour = "#fff" if count == 0 else "rgba({},{},{},{:.2f})".format(*base, 0.15 + 0.6 * share)
            cells.append({"count": count, "colour": colour})
        table.append({"name": f"{true} ({total})", "cells": cells})
    return {"title": title, "columns": columns, "rows": table}


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.0f} %"


def _excitation(item: dict[str, Any]) -> str:
    """How the robot was moved; servos follow commands, and bodies are thrown."""
    return item["opened"].get("settings", {}).get("excitation") or (
        "of servos" if item["kind"] == "served" else "of throws"
    )


def _groups(scores: Scores) -> list[dict[str, Any]]:
    """Rows for families, rigs, noises and laws that the vocabulary does not state exactly."""
    single = [item for item in scores if item["kind"] == "single"]
    groups: list[tuple[str, list[dict[str, Any]]]] = []
    for family in dict.fromkeys(FAMILY.values()):
        groups.append((f"single, {family}", [item for item in single if FAMILY[item["truth"][0][0]] == family]))
    for rig in sorted({item["rig"] for item in scores}):
        groups.append((f"single, {rig}", [item for item in single if item["rig"] == rig]))
    for noise in sorted({item["opened"]["noise"]["kind"] for item in scores}):
        groups.append(
            (
                f"nulls, {noise} noise",
                [x for x in scores if x["kind"] == "null" and x["opened"]["noise"]["kind"] == noise],
            )
        )
    for name in sorted({_excitation(item) for item in scores}):
        groups.append((f"single, excitation {name}", [item for item in single if _excitation(item) == name]))
    groups.append(("single, process noise", [item for item in single if item["process"]]))
    groups.append(
        (
            "single, law not the vocabulary's own",
            [x for x in single if not all(e.get("exact", True) for e in x["opened"]["effects"])],
        )
    )
    rows = []
    for name, items in groups:
        if not items:
            continue
        null = name.startswith("nulls")
        clear = [] if null else [item for item in items if item["clear"]]
        rows.append(
            {
                "name": name,
                "count": len(items),
                "clear_count": "" if null else len(clear),
                "right_clear": "" if null else _percent(part(clear, "right")),
                "right": _percent(part(items, "right")),
            }
        )
    return rows


def _failures(scores: Scores) -> list[dict[str, Any]]:
    rows = []
    for item in sorted(scores, key=lambda item: (-float(item["clear"]), item["kind"], item["slot"])):
        if item["right"]:
            continue
        accept = ", ".join(f"{other['effect']} {other['at']}".strip() for other in item["opened"].get("accept", []))
        named = "; ".join(f"{name} at {at}" for name, at in item["named"])
        rows.append(
            {
                "truth": "; ".join(f"{name} at {at}" for name, at in item["truth"]) or "nothing",
                "rig": item["rig"],
                "strength": ", ".join(f"{value:.2g}" for value in item["strengths"]),
                "told": f"{item['verdict']}{': ' + named if named else ''}",
                "failure": item["failure"],
                "command": f"python -m tests.concealed.make --kind {item['case_kind']} --rig {item['case_rig']} "
                f"--seed {item['seed']} --out case_{item['slot']}",
                "concealed": json.dumps(item["opened"]["effects"], default=float),
                "accept": accept,
            }
        )
    return rows


def _held_out(scores: Scores) -> dict[str, str]:
    """Of the gains on held-out runs: how many, quartiles, mean, and its standard error by run."""
    gains = held_out_gains(scores)
    if len(gains) < 2:
        return {}
    names = ("lower", "median", "upper")
    found = {name: f"{value:.3g}" for name, value in zip(names, np.percentile(gains, [25, 50, 75]), strict=True)}
    error = np.std(gains, ddof=1) / np.sqrt(len(gains))
    return found | {"count": str(len(gains)), "mean": f"{np.mean(gains):.3g}", "error": f"{error:.2g}"}


def _composition(scores: Scores, rigs: Sequence[str]) -> list[dict[str, Any]]:
    rows = []
    for kind, name in (
        ("single", "one effect"),
        ("null", "nothing concealed"),
        ("odd", "outside the vocabulary"),
        ("pair", "two effects"),
        ("many", "5 to 20 effects"),
    ):
        items = [item for item in scores if item["kind"] == kind]
        counts = [sum(item["rig"] == rig for item in items) for rig in rigs]
        clear = "" if kind == "null" else sum(item["clear"] for item in items)
        rows.append({"kind": name, "counts": counts, "all": len(items), "clear_count": clear})
    return rows


def write_page(path: Path, about: dict[str, Any], scores: Scores, elapsed: float) -> None:
    """Writes the page at once, never half of it."""
    template = Environment(autoescape=True).from_string((Path(__file__).parent / "page.html").read_text())
    rigs = sorted({item["rig"] for item in scores})
    median = {
        key: f"{np.median([item[key] for item in scores]):.1f} s" if scores else "–"
        for key in ("made_seconds", "diagnosed_seconds")
    }
    text = template.render(
        about=about,
        debug=any(start["debug_seed"] for start in about["starts"]),
        trials=len(scores),
        elapsed=elapsed,
        made=median["made_seconds"],
        diagnosed=median["diagnosed_seconds"],
        figures=figures(scores),
        held_out=_held_out(scores),
        rigs=rigs,
        composition=_composition(scores, rigs),
        curve_svg=curve_svg(scores),
        calibration_svg=calibration_svg(scores),
        groups=_groups(scores),
        many_by_effect=by_effect(scores),
        many_by_sigma=by_sigma(scores),
        matrices=[
            _matrix(scores, "Confusion, clear cases (true names down, told names across)", True),
            _matrix(scores, "Confusion, all cases", False),
        ],
        failures=_failures(scores),
        seals=scores,
    )
    part_path = path.with_suffix(".part")
    part_path.write_text(text)
    part_path.replace(path)
