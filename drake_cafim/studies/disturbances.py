"""Study `disturbances`: the paper's limitations, process noise and contact outside the planned frame."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.studies.cell import SCENARIOS, Cell, select_varied
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, ratio_of_medians

PROCESS = (0.1, 0.3)  # m/s, against commands of up to 1 m/s (hefting, rubbing), 0.5 (contouring) and 0.3 (pinching)
OUTSIDE = 0.002  # m
FIXED = ("rubbing", "pinching", "contouring")  # scenarios in which what touches has a place


def disturbance_cells(short: bool, count: int = 20) -> list[Cell]:
    """Contact-aware runs, 20 seeds: undisturbed, with process noise at two levels, and with contact 2 mm too early."""
    seeds = range(1 if short else count)
    cells = [Cell(name, seed) for name in SCENARIOS for seed in seeds]
    cells += [Cell(name, seed, process_noise=std) for name in SCENARIOS for std in PROCESS for seed in seeds]
    return cells + [Cell(name, seed, outside=OUTSIDE) for name in FIXED for seed in seeds]


def disturbances(results: Mapping[Cell, Any]) -> Findings:
    """Errors with each disturbance beside those without."""
    about = (
        "Either white noise is added to the commanded velocity, while the robot's position is measured without error; "
        "or the surface that touches stands out 2 mm from where planning and estimation assume it."
    )
    header = ("", "seeds", "median errors, %", "interval holds", "contact", "largest force, N")
    rows = []
    for name in SCENARIOS:
        for label, runs in _groups(results, name).items():
            if runs:
                rows.append((f"{name}, {label}", *_row(runs)))
    table = Table("By disturbance", header, tuple(rows))
    return Findings("Disturbances", about, tuple(disturbance_claims(results)), (table,))


def disturbance_claims(results: Mapping[Cell, Any]) -> list[Claim]:
    """Whether each disturbance increases the errors: claims with the ratio of median errors."""
    claims = []
    for name in SCENARIOS:
        groups = _groups(results, name)
        plain = groups.pop("undisturbed")
        for label, runs in groups.items():
            if not runs:
                continue
            worse = ratio_of_medians(_errors(runs), _errors(plain))
            found = f"errors times {worse}; 95 % intervals hold {_coverage(runs)}"
            claims.append(Claim(f"{name}: {label} limits", found, worse.standing))
    return claims


def _groups(results: Mapping[Cell, Any], name: str) -> dict[str, list[dict[str, Any]]]:
    own = {cell: kept for cell, kept in results.items() if cell.scenario == name}
    shaken, moved = select_varied(own, "process_noise"), select_varied(own, "outside")
    groups = {"undisturbed": list(select_varied(own).values())}
    for std in PROCESS:
        groups[f"process noise of {std:g} m/s"] = [k for cell, k in shaken.items() if cell.process_noise == std]
    groups["contact 2 mm outside the planned frame"] = [k for cell, k in moved.items() if cell.outside == OUTSIDE]
    return groups


def _errors(runs: Sequence[dict[str, Any]]) -> list[float]:
    return list(final_errors(runs).mean(axis=1).tolist())


def _coverage(runs: Sequence[dict[str, Any]]) -> str:
    """For each parameter, the fraction of runs whose 95 % interval contains the truth."""
    inside = np.mean([run["experiments"][-1]["inside"] for run in runs], axis=0)
    return ", ".join(f"{share:.2f}" for share in inside)


def _row(runs: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    return (
        f"{len(runs)}",
        ", ".join(f"{value:.2f}" for value in np.median(final_errors(runs), axis=0)),
        _coverage(runs),
        f"{np.mean(behaviours(runs, 'contact_fraction')):.2f}",
        f"{max(behaviours(runs, 'max_force')):.1f}",
    )
