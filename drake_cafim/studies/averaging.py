"""Study `belief-averaging`: plans scored over points of the belief against plans at its mode, paired by seed."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings, Standing, Table
from drake_cafim.studies.paired import paired_difference, paired_ratio

SAMPLES = 5
CASES = (  # scenario, the prior's mean over the truth
    ("rubbing", 1.3),
    ("rubbing", 3.0),
    ("contouring", 0.5),
    ("contouring", 1.5),
    ("pinching", 0.5),
    ("pinching", 1.3),
    ("hefting", 0.5),
)


def averaging_cells(short: bool) -> list[Cell]:
    """The first experiment planned at the mode and over the belief, for each case and 24 seeds."""
    seeds = range(2 if short else 24)
    return [
        Cell(name, seed, prior_scale=scale, belief_samples=samples, experiments=1)
        for name, scale in CASES
        for samples in (1, SAMPLES)
        for seed in seeds
    ]


def averaging(results: Mapping[Cell, Any]) -> Findings:
    """Information, error, largest force and planning time of belief-averaged plans and of plans at the mode."""
    rows, claims = [], []
    for name, scale in CASES:
        case = {c: kept for c, kept in results.items() if (c.scenario, c.prior_scale) == (name, scale)}
        mode, averaged = ([kept for c, kept in case.items() if c.belief_samples == count] for count in (1, SAMPLES))
        label = f"{name}, prior {100 * (scale - 1):+.0f} %"
        gain = paired_ratio(_of(averaged, "information"), _of(mode, "information"))
        by_mode, by_belief = _errors(mode), _errors(averaged)
        difference = paired_difference(by_belief, by_mode)
        rows.append(
            (
                label,
                str(gain),
                *(f"{np.median(errors):.2f}" for errors in (by_mode, by_belief)),
                "{:+.2f} ({:+.2f} to {:+.2f})".format(*difference),
                *(f"{np.median([_force(run) for run in runs]):.1f}" for runs in (mode, averaged)),
                *(f"{np.median(_of(runs, 'planning_ms')):.2f}" for runs in (mode, averaged)),
                f"{1e3 * case[next(iter(case))]['period']:.0f}",
            )
        )
        claims.append(Claim(f"{label}: the belief's plan has a smaller error", rows[-1][4], _standing(difference)))
    header = (
        "",
        "information over the mode's",
        "error by mode, %",
        "by belief, %",
        "difference, points",
        "largest force by mode, N",
        "by belief, N",
        "planning by mode, ms",
        "by belief, ms",
        "dt, ms",
    )
    title = f"{SAMPLES} points of the belief beside its mode: {len(mode)} paired seeds"
    about = (
        "The first experiment, where the belief is widest. The score is the mean over equally weighted points of the "
        "belief; cafim run --belief-samples N. Intervals are 95 %, by bootstrap over seeds."
    )
    return Findings("Belief-averaged information", about, tuple(claims), (Table(title, header, tuple(rows)),))


def _of(runs: list[dict[str, Any]], name: str) -> list[float]:
    return [float(run["experiments"][0][name]) for run in runs]


def _errors(runs: list[dict[str, Any]]) -> list[float]:
    """|error| in percent after the experiment, the mean over parameters."""
    return [float(np.abs(run["experiments"][0]["error"]).mean()) for run in runs]


def _force(run: dict[str, Any]) -> float:
    return float(run["experiments"][0]["behaviour"]["max_force"])


def _standing(difference: tuple[float, float, float]) -> Standing:
    _, low, high = difference
    if high < 0.0:
        return "holds"
    return "does not hold" if low > 0.0 else "ties"
