"""Study `hefting-table`: hefting with its robot under the planner's contact law and under Drake's."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.diagrams.world import WorldKind
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, information, require

KINDS: tuple[WorldKind, ...] = ("model", "drake")


def hefting_table_cells(short: bool) -> list[Cell]:
    """Hefting in both worlds, and the policy `hold` in both for comparison."""
    seeds, experiments = (range(1), 1) if short else (range(1, 21), None)
    cells = [Cell("hefting", seed, world=kind, experiments=experiments) for seed in seeds for kind in KINDS]
    return [*cells, *(Cell("hefting", 1, "hold", world=kind, experiments=1) for kind in KINDS)]


def hefting_table(results: Mapping[Cell, Any]) -> Findings:
    """The table of hefting in both worlds, and the requirements on world `model`."""
    rows, claims = [], []
    for kind in KINDS:
        runs = [kept for cell, kept in results.items() if cell.world == kind and cell.policy == "contact-aware"]
        held = [kept for cell, kept in results.items() if cell.world == kind and cell.policy == "hold"]
        figures = _figures(runs, held)
        rows.append((f"world {kind}, {len(runs)} seeds", *(f"{value:.3g}" for value in figures.values())))
        if kind == "model":
            claims = _required(figures)
    table = Table("Hefting with the arm", ("", *figures), tuple(rows))
    return Findings("Hefting in a Diagram", "An arm carries the hand; prior 30 % too high.", tuple(claims), (table,))


def _figures(runs: Sequence[dict[str, Any]], held: Sequence[dict[str, Any]]) -> dict[str, float]:
    errors = final_errors(runs)[:, 0]
    flat = [experiment for run in runs for experiment in run["experiments"]]
    return {
        "median error, %": float(np.median(errors)),
        "95th percentile, %": float(np.percentile(errors, 95)),
        "F / F_hold": float(np.mean(information(runs)) / np.mean(information(held))),
        "airborne": float(np.mean(behaviours(runs, "airborne_fraction"))),
        "reversals": float(np.mean(behaviours(runs, "reversals"))),
        "95 % interval holds the truth": float(np.mean([run["experiments"][-1]["inside"][0] for run in runs])),
        "tracking error, m/s": float(np.median([experiment["tracking_error"] for experiment in flat])),
        "planning, ms": float(np.median([experiment["planning_ms"] for experiment in flat])),
    }


def _required(figures: Mapping[str, float]) -> list[Claim]:
    return [
        require("median final error, %", figures["median error, %"], 4.5, at_most=True),
        require("F / F_hold", figures["F / F_hold"], 1.5),
        require("airborne fraction", figures["airborne"], 0.05, at_most=True, digits=3),
        require("reversals an experiment", figures["reversals"], 6.0),
    ]
