"""Study `force-guard`: violations of the force limit with a model that is too soft, with and without the guard."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, information

LIMIT = 10.0  # N, of both tasks
CASES: Mapping[str, Cell] = {
    "pinching, prior 50 % too low": Cell("pinching", 0, prior_scale=0.5, experiments=3),
    "pinching, prior 30 % too low": Cell("pinching", 0, prior_scale=0.7, experiments=3),
    "contouring, box twice as hard as believed": Cell("contouring", 0, believed=(("stiffness", 250.0),)),
    "pinching in Drake, prior 50 % too low": Cell("pinching", 0, prior_scale=0.5, experiments=1, world="drake"),
}


def guarding_cells(short: bool) -> list[Cell]:
    """Contact-aware runs with the guard, 40 seeds, and without it, 10 seeds."""
    guarded, bold = (range(1), range(1)) if short else (range(40), range(10))
    cells = [replace(case, seed=seed, force_guard=False) for case in CASES.values() for seed in bold]
    return cells + [replace(case, seed=seed, force_guard=True) for case in CASES.values() for seed in guarded]


def guarding(results: Mapping[Cell, Any]) -> Findings:
    """Violations of the limit by the true force, and contact, information and error with and without the guard."""
    rows, claims = [], []
    for name, case in CASES.items():
        for guard in (False, True):
            runs = [k for c, k in results.items() if c == replace(case, seed=c.seed, force_guard=guard)]
            forces = np.array(behaviours(runs, "max_force"), dtype=float)
            broken = int((forces > LIMIT).sum())
            rows.append(
                (
                    name,
                    "guarded" if guard else "not guarded",
                    f"{broken} of {len(forces)}",
                    f"{forces.max():.1f}",
                    f"{np.median(forces):.1f}",
                    f"{np.mean(behaviours(runs, 'contact_fraction')):.2f}",
                    f"{np.median(information(runs)):.3g}",
                    ", ".join(f"{error:.1f}" for error in np.median(final_errors(runs), axis=0)),
                )
            )
        found = f"{broken} of {len(forces)} experiments exceed it"
        claims.append(
            Claim(
                f"{name}: the guard keeps the force within {LIMIT:g} N", found, "does not hold" if broken else "holds"
            )
        )
    header = (
        "",
        "",
        "experiments over the limit",
        "largest force, N",
        "median of the largest, N",
        "contact",
        "information",
        "median final error, %",
    )
    table = Table(f"Limit {LIMIT:g} N in true force", header, tuple(rows))
    about = (
        "The guard limits commands by measured forces and allows for errors of the model; plans account for it. "
        "cafim run --force-guard, --no-force-guard."
    )
    return Findings("Force limits in execution", about, tuple(claims), (table,))
