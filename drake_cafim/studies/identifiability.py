"""Study `identifiability`: friction and stiffness together, from both forces or from the tangential one alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings, Table, final_errors, require
from drake_cafim.typing import Array

SENSORS = {"rubbing_two": "both forces", "rubbing_tangential": "tangential force alone"}


def identifiability_cells(short: bool) -> list[Cell]:
    """Three experiments with each sensor, 40 seeds."""
    seeds, experiments = (range(1), 1) if short else (range(40), 3)
    return [Cell(name, seed, experiments=experiments) for name in SENSORS for seed in seeds]


def identifiability(results: Mapping[Cell, Any]) -> Findings:
    """Rank, errors and coverage of friction, stiffness and their product with each sensor."""
    rows: list[tuple[str, ...]] = []
    claims: list[Claim] = []
    for name, sensor in SENSORS.items():
        runs = [kept for cell, kept in results.items() if cell.scenario == name]
        last = [run["experiments"][-1] for run in runs]
        ranks = sorted({experiment["rank"] for experiment in last})
        expected = 2 if name == "rubbing_two" else 1
        found = ", ".join(map(str, ranks))
        claims.append(Claim(f"{sensor}: rank {expected}", found, "holds" if ranks == [expected] else "does not hold"))
        errors = final_errors(runs)
        for index, parameter in enumerate(runs[0]["parameters"]):
            inside = float(np.mean([experiment["inside"][index] for experiment in last]))
            std = float(np.median([experiment["std"][index] for experiment in last]))
            rows.append(_row(sensor, parameter, errors[:, index], std, inside))
            if expected == 2:
                claims.append(require(f"{sensor}: coverage of {parameter}", inside, 0.9))
        product = np.array([_product_error(experiment) for experiment in last])
        if expected == 1:
            stds = np.array([experiment["combinations"][0]["std_percent"] for experiment in last])
            inside = float(np.mean(np.abs(product) <= 1.96 * stds))
            rows.append(
                _row(sensor, last[0]["combinations"][0]["text"], np.abs(product), float(np.median(stds)), inside)
            )
            same = all(
                np.allclose(list(experiment["combinations"][0]["exponents"].values()), 1.0, atol=1e-3)
                for experiment in last
            )
            text = " | ".join(sorted({experiment["combinations"][0]["text"] for experiment in last}))
            claims.append(Claim(f"{sensor}: what is known is the product", text, "holds" if same else "does not hold"))
            claims.append(require(f"{sensor}: coverage of the product", inside, 0.9))
    header = ("measured", "of", "median error, %", "95th percentile, %", "stated std, %", "95 % interval holds it")
    table = Table(f"After the last experiment, {len(runs)} seeds", header, tuple(rows))
    about = "Rubbing an elastic wall; scenarios rubbing_two and rubbing_tangential, prior 30 % too high."
    return Findings("Friction and stiffness together", about, tuple(claims), (table,))


def _row(sensor: str, what: str, errors: Array, std: float, inside: float) -> tuple[str, ...]:
    figures = (float(np.median(errors)), float(np.percentile(errors, 95)), std)
    return (sensor, what, *(f"{figure:.2f}" for figure in figures), f"{inside:.2f}")


def _product_error(experiment: Mapping[str, Any]) -> float:
    """The error of the product of friction and stiffness, percent."""
    return 100.0 * (float(np.prod([1.0 + 0.01 * error for error in experiment["error"]])) - 1.0)
