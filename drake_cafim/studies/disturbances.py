"""Study `disturbances`: process noise, and contact outside the planned frame, which the paper names as its limits."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.studies.cell import SCENARIOS, Cell, select_varied
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, ratio_of_medians

PROCESS = (0.1, 0.3)  # m/s, against commands of up to 1 m/s (hefting, rubbing), 0.5 (contouring) and 0.3 (pinching)
OUTSIDE = 0.002  # m
BESIDE = (0.002, 1.0)  # m along each axis, and degrees
UNKNOWN: Mapping[str, float] = {"place_std": 0.003, "tilt_std": 1.0}
FIXED = ("rubbing", "pinching", "contouring")  # scenarios in which what touches has a place


def disturbance_cells(short: bool, count: int = 20) -> list[Cell]:
    """Contact-aware runs, 20 seeds: undisturbed, with process noise at two levels, and with contact 2 mm too early."""
    seeds = range(1 if short else count)
    cells = [Cell(name, seed) for name in SCENARIOS for seed in seeds]
    cells += [Cell(name, seed, process_noise=std) for name in SCENARIOS for std in PROCESS for seed in seeds]
    return cells + [Cell(name, seed, outside=OUTSIDE) for name in FIXED for seed in seeds]


def frame_cells(short: bool) -> list[Cell]:
    """20 seeds with what is touched moved by 2 mm and turned by 1°, which the estimator knows nothing of, or learns."""
    kinds = [(name, unknown) for name in FIXED for unknown in ({}, _unknown(name))]
    seeds = range(1 if short else 20)
    return [Cell(name, seed, beside=BESIDE, **unknown) for name, unknown in kinds for seed in seeds]


def _unknown(name: str) -> dict[str, Any]:
    """The priors of the frame that the scenario can learn: between jaws a tilt is not felt."""
    return {key: std for key, std in UNKNOWN.items() if key == "place_std" or name != "pinching"}


def disturbances(results: Mapping[Cell, Any]) -> Findings:
    """Errors with each disturbance beside those without."""
    about = (
        "Either white noise is added to the commanded velocity, while the robot's position is measured without error; "
        "or the surface that touches stands out 2 mm from where planning and estimation assume it; or what is touched "
        "is moved by 2 mm along each axis and turned by 1°, of which the estimator knows nothing, or which it learns "
        "as nuisance, with priors of 3 mm and 1° (between jaws the turn is not felt)."
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
    beside = select_varied(own, "beside", "place_std", "tilt_std")
    for label, learned in (("", False), (", learned", True)):
        groups[f"contact moved 2 mm and turned 1°{label}"] = [
            kept for cell, kept in beside.items() if cell.beside == BESIDE and bool(cell.place_std) == learned
        ]
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
