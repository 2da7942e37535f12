"""Study `reaching`: whether and when planners with a horizon of 0.2 s find a wall that is half a metre away."""

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from drake_cafim.design.planner import PlannerName
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours
from drake_cafim.tasks.rubbing import rubbing

PLANNERS: tuple[PlannerName, ...] = get_args(PlannerName)
UNSOUGHT = (("seeking", 0.0),)


def reaching_cells(short: bool) -> list[Cell]:
    """The first rubbing experiment by each planner, and by predictive sampling without cost of distance, 40 seeds."""
    seeds = range(1 if short else 40)
    cells = [Cell("rubbing", seed, planner=planner, experiments=1) for planner in PLANNERS for seed in seeds]
    return cells + [Cell("rubbing", seed, experiments=1, believed=UNSOUGHT) for seed in seeds]


def reaching(results: Mapping[Cell, Any]) -> Findings:
    """The fraction of seeds that find contact, and the time until then."""
    task = rubbing()
    start = float(task.robot_start[0])
    model: Any = task.model
    soonest = (start - model.tip_radius) / model.speed_limit
    rows, claims = [], []
    for planner in PLANNERS:
        runs = [kept for cell, kept in results.items() if cell.planner == planner and cell.believed == ()]
        rows.append((planner, *_figures(runs)))
        claims.append(
            Claim(f"{planner}: every seed finds contact", rows[-1][1], "holds" if _all(runs) else "does not hold")
        )
    unsought = [kept for cell, kept in results.items() if cell.believed == UNSOUGHT]
    rows.append(("predictive-sampling, distance costs nothing", *_figures(unsought)))
    header = ("", "find contact", "median time, s", "latest, s", "share of the time in contact")
    table = Table(f"From {start:g} m away; at full speed it takes {soonest:.2f} s", header, tuple(rows))
    about = "Rubbing, the first experiment, from the scenario's own start. A plan looks 0.2 s ahead."
    return Findings("Finding contact", about, tuple(claims), (table,))


def _times(runs: list[dict[str, Any]]) -> list[float]:
    """The time of the first contact of each run, s; infinite without one."""
    return [np.inf if time is None else float(time) for time in behaviours(runs, "first_contact")]


def _all(runs: list[dict[str, Any]]) -> bool:
    return bool(np.isfinite(_times(runs)).all())


def _figures(runs: list[dict[str, Any]]) -> tuple[str, ...]:
    times = np.array(_times(runs))
    found = times[np.isfinite(times)]
    share = f"{len(found)} of {len(times)}"
    contact = f"{np.mean(behaviours(runs, 'contact_fraction')):.2f}"
    if not len(found):
        return share, "never", "never", contact
    return share, f"{np.median(found):.2f}", f"{found.max():.2f}", contact
