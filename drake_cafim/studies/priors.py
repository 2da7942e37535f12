"""Studies `robustness` and `calibration`: errors from seven priors, and the coverage of the 95 % intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.diagrams.world import WorldKind
from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.findings import Claim, Findings, Table, final_errors, require, world_name

SCALES = (0.5, 0.7, 0.9, 1.0, 1.1, 1.3, 1.5)
COVERAGE = {"hefting": 0.90, "rubbing": 0.90, "pinching": 0.90, "contouring": 0.83}


def robustness_cells(short: bool, world: WorldKind | None = None) -> list[Cell]:
    """Contact-aware runs from seven prior means, 40 seeds each."""
    seeds = range(1 if short else 40)
    return [
        Cell(name, seed, prior_scale=scale, world=world) for name in SCENARIOS for scale in SCALES for seed in seeds
    ]


def robustness(results: Mapping[Cell, Any]) -> Findings:
    """Median final error by scenario, parameter and prior."""
    medians = _medians(results)
    rows = tuple((which, *(f"{value:.2f}" for value in column)) for which, column in medians.items())
    header = ("median error, %", *(f"{100 * (scale - 1):+.0f} %" for scale in SCALES))
    table = Table("By the prior's mean", header, rows)
    return Findings(
        "Robustness to the prior",
        f"Contact-aware, from seven priors, in {world_name(results)}.",
        tuple(prior_claims(results)),
        (table,),
    )


def prior_claims(results: Mapping[Cell, Any]) -> list[Claim]:
    """Claims that the median error is at most 9 % from every prior; `results` hold all scenarios at all `SCALES`."""
    return [
        require(f"{which}, largest of seven medians, %", max(column), 9.0, at_most=True)
        for which, column in _medians(results).items()
    ]


def _medians(results: Mapping[Cell, Any]) -> dict[str, list[float]]:
    """By scenario and parameter, the median final error of each prior."""
    found: dict[str, list[float]] = {}
    for name in SCENARIOS:
        by_scale = [
            np.median(
                final_errors([k for c, k in results.items() if c.scenario == name and c.prior_scale == scale]), axis=0
            )
            for scale in SCALES
        ]
        parameters = next(kept["parameters"] for cell, kept in results.items() if cell.scenario == name)
        for index, parameter in enumerate(parameters):
            found[f"{name}: {parameter}"] = [float(medians[index]) for medians in by_scale]
    return found


def calibration_cells(short: bool, world: WorldKind | None = None) -> list[Cell]:
    """Contact-aware runs, 400 seeds; 200 with robots, whose simulation takes longer."""
    seeds = range(3 if short else 400 if world is None else 200)
    return [Cell(name, seed, world=world) for name in SCENARIOS for seed in seeds]


def calibration(results: Mapping[Cell, Any]) -> Findings:
    """The coverage of the 95 % interval after the last experiment, and mean and std of error / std."""
    claims: list[Claim] = []
    rows = []
    for name in SCENARIOS:
        runs = [kept for cell, kept in results.items() if cell.scenario == name]
        last = [kept["experiments"][-1] for kept in runs]
        inside = np.array([experiment["inside"] for experiment in last])
        error, std = (np.array([experiment[key] for experiment in last]) for key in ("error", "std"))
        off = error / std
        columns = zip(
            runs[0]["parameters"],
            inside.mean(axis=0),
            off.mean(axis=0),
            off.std(axis=0),
            np.median(std, axis=0),
            strict=True,
        )
        for parameter, share, mean, spread, typical in columns:
            half = 1.96 * float(np.sqrt(share * (1.0 - share) / len(runs)))
            rows.append(
                (
                    f"{name}: {parameter}",
                    f"{share:.3f}",
                    f"± {half:.3f}",
                    f"{len(runs)}",
                    f"{typical:.1f}",
                    f"{mean:.2f}",
                    f"{spread:.2f}",
                )
            )
            claims.append(require(f"{name}: coverage of {parameter}", float(share), COVERAGE[name], digits=3))
    header = ("", "share", "95 %", "runs", "median std, %", "mean of error / std", "std of error / std")
    table = Table("The 95 % interval holds the truth", header, tuple(rows))
    about = (
        f"Contact-aware, prior 30 % too high, in {world_name(results)}. Stiffness's prior is wrong by 2.4 of its own "
        "standard deviations: it pulls estimates up by 2.4 std / prior std (12.5 %) of the final ones."
    )
    return Findings("Calibration", about, tuple(claims), (table,))
