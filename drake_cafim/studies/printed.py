"""Study `as-printed`: the paper's own choices beside ours, where they can run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.findings import Findings, Table, behaviours, final_errors


def printed_cells(short: bool) -> list[Cell]:
    """Both from the same 40 seeds, under the planner's own law with perfect tracking; hefting with its robot, 20."""
    seeds, fewer = (range(1), range(1)) if short else (range(40), range(20))
    cells = []
    for name in SCENARIOS:
        world = "model" if name == "hefting" else None  # the rigid ball has no law that could be the paper's
        for seed in fewer if name == "hefting" else seeds:
            cells += [Cell(name, seed, world=world, as_printed=printed) for printed in (False, True)]  # type: ignore[arg-type]
    return cells


def printed(results: Mapping[Cell, Any]) -> Findings:
    """A row for each scenario and each set of choices."""
    rows = []
    for name in SCENARIOS:
        for of_paper in (False, True):
            runs = [kept for cell, kept in results.items() if (cell.scenario, cell.as_printed) == (name, of_paper)]
            errors = final_errors(runs)
            inside = np.mean([run["experiments"][-1]["inside"] for run in runs], axis=0)
            rows.append(
                (
                    name,
                    "the paper's" if of_paper else "ours",
                    f"{len(runs)}",
                    ", ".join(f"{value:.1f}" for value in np.median(errors, axis=0)),
                    ", ".join(f"{value:.1f}" for value in np.percentile(errors, 95, axis=0)),
                    ", ".join(f"{value:.2f}" for value in inside),
                    f"{np.mean(behaviours(runs, 'contact_fraction')):.2f}",
                    f"{max(behaviours(runs, 'max_force')):.1f}",
                )
            )
    header = ("", "choices", "seeds", "median error, %", "95th percentile", "interval holds")
    header = (*header, "contact", "largest force, N")  # type: ignore[assignment]
    about = (
        "The paper's: the trace, its contact law, no reward for approaching, C = 0 in hefting, variances of 100 and 10 "
        "as the prior of pinching. The world's contact is Kelvin and Voigt's for both."
    )
    return Findings("As the paper prints it", about, (), (Table("As printed and as built", header, tuple(rows)),))
