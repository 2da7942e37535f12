"""Study `requirements`: the errors, information and behaviour that each scenario must reach, and whether it does."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.design.policies import PolicyName
from drake_cafim.diagrams.world import WorldKind
from drake_cafim.studies.cell import SCENARIOS, Cell, select_varied
from drake_cafim.studies.findings import (
    Claim,
    Findings,
    behaviours,
    final_errors,
    information,
    require,
    world_name,
)
from drake_cafim.studies.priors import calibration, calibration_cells, prior_claims, robustness_cells

MEDIAN = {"hefting": (4.5,), "rubbing": (3.0,), "pinching": (5.0, 11.0), "contouring": (3.5, 6.0)}  # %
WORST = {"hefting": 14.0, "rubbing": 8.0}  # %, 95th percentile
BASELINE: Mapping[str, tuple[PolicyName, float]] = {
    "hefting": ("hold", 1.5),
    "pinching": ("scripted", 3.0),
    "contouring": ("scripted", 8.0),
}


def requirement_cells(short: bool, world: WorldKind | None = None) -> list[Cell]:
    """The cells of `calibration` and `robustness`, and four seeds of each baseline policy of `BASELINE`."""
    baselines = [
        Cell(name, seed, policy, world=world)
        for name, (policy, _) in BASELINE.items()
        for seed in range(2 if short else 4)
    ]
    return calibration_cells(short, world) + robustness_cells(short, world) + baselines


def requirements(results: Mapping[Cell, Any]) -> Findings:
    """One claim for each requirement."""
    claims: list[Claim] = []
    default = select_varied(results, "world")
    for name in SCENARIOS:
        runs = [kept for cell, kept in default.items() if cell.scenario == name]
        found = _claims(name, runs)
        if name in BASELINE:
            policy, least = BASELINE[name]
            other = [kept for cell, kept in results.items() if cell.scenario == name and cell.policy == policy]
            ratio = float(np.mean(information(runs)) / np.mean(information(other)))
            found.append(require(f"{name}: information over {policy}", ratio, least))
        claims += found
    about = (
        f"Contact-aware, prior 30 % too high unless seven priors are compared, in {world_name(results)}. The studies "
        "robustness and calibration use the same runs and show more of them."
    )
    seven = prior_claims(select_varied(results, "world", "prior_scale"))
    return Findings("Required figures", about, (*claims, *calibration(default).claims, *seven))


def _claims(name: str, runs: Sequence[dict[str, Any]]) -> list[Claim]:
    errors = final_errors(runs)
    parameters = runs[0]["parameters"]
    claims = [
        require(f"{name}: median error of {parameter}, %", float(median), bound, at_most=True)
        for parameter, median, bound in zip(parameters, np.median(errors, axis=0), MEDIAN[name], strict=True)
    ]
    if name in WORST:
        worst = float(np.percentile(errors, 95))
        claims.append(require(f"{name}: 95th percentile of the error, %", worst, WORST[name], at_most=True))
    period = 1e3 * float(runs[0]["period"])
    slowest = float(np.median([experiment["planning_ms"] for run in runs for experiment in run["experiments"]]))
    claims.append(require(f"{name}: median planning step, ms", slowest, period, at_most=True))
    return claims + _behaviour(name, runs)


def _behaviour(name: str, runs: Sequence[dict[str, Any]]) -> list[Claim]:
    def mean(kind: str) -> float:
        return float(np.mean(behaviours(runs, kind)))

    if name == "hefting":
        return [
            require("hefting: airborne fraction", mean("airborne_fraction"), 0.05, at_most=True, digits=3),
            require("hefting: reversals", mean("reversals"), 6.0, digits=1),
        ]
    if name == "rubbing":
        first = [np.inf if time is None else float(time) for time in behaviours(runs, "first_contact")]
        return [
            require("rubbing: contact fraction", mean("contact_fraction"), 0.85),
            require("rubbing: sliding fraction", mean("sliding_fraction"), 0.70),
            require("rubbing: median first contact, s", float(np.median(first)), 0.6, at_most=True),
            require("rubbing: share of experiments that find contact", float(np.mean(np.isfinite(first))), 1.0),
        ]
    if name == "pinching":
        return [require("pinching: makes and breaks", mean("make_breaks"), 6.0, digits=1)]
    both = [{face[1] for face in faces} == {"x", "y"} for faces in behaviours(runs, "faces")]
    return [require("contouring: both axes touched", float(np.mean(both)), 0.95)]
