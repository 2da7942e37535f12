"""Study `laws`: in Drake's contact, does the robot find that its contact law is wrong, and which one is right?"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.findings import Claim, Findings, Table, require

ORDER = ("pinching", "contouring", "rubbing", "hefting")
"""The cheapest first."""
DECIDED = float(np.log(20.0))
"""Log odds at which a law counts as found."""
RIGHT = {"drake": "hydroelastic", "model": "kelvin_voigt"}
MEDIAN = {
    "pinching": {"modulus": 5.0, "dissipation": 12.0},
    "contouring": {"length": 3.5, "width": 6.0},
    "rubbing": {"friction": 3.0},
    "hefting": {"mass": 4.5},
}
COVERAGE = {"pinching": 0.90, "contouring": 0.83, "rubbing": 0.90, "hefting": 0.90}


def law_cells(short: bool) -> list[Cell]:
    """All laws as candidates, from 100 seeds; from 40 with a prior 30 % too low; with the own law alone, and random.

    And where the scenario's own law is the world's, in the kinematic world.
    """
    many, some, few = (range(n) for n in ((1, 1, 1) if short else (100, 40, 20)))
    cells = []
    for name in ORDER:
        cells += [Cell(name, seed, world="drake", law="all") for seed in many]
        cells += [Cell(name, seed, world="drake", law="all", prior_scale=0.7) for seed in some]
        cells += [Cell(name, seed, world="drake") for seed in few]
        cells += [Cell(name, seed, "random", world="drake", law="all") for seed in few]
        if name != "hefting":
            cells += [Cell(name, seed, law="all") for seed in some]
    return cells


def laws(results: Mapping[Cell, Any]) -> Findings:
    """A row for each kind of run, and a claim for each requirement."""
    claims: list[Claim] = []
    rows = []
    for name in SCENARIOS:
        groups: dict[tuple[str, str, float, str | None], list[dict[str, Any]]] = {}
        for cell, kept in results.items():
            if cell.scenario == name:
                world = "model" if cell.world is None else cell.world
                groups.setdefault((cell.policy, world, cell.prior_scale, cell.law), []).append(kept)
        for group, runs in groups.items():
            rows.append(_row(name, group, runs))
            claims += _claims(name, group, runs)
    which = ("", "candidates", "world", "prior", "seeds", "right law ≥ 20 : 1", "a wrong one")
    header = (*which, "median error, %", "95th percentile", "interval holds")
    about = (
        "The planner begins with Kelvin and Voigt's law; the others are candidates. Errors are those of the most "
        "probable law, at its own true values. Random motions and the planner's own law alone stand beside it."
    )
    return Findings("Which contact law", about, tuple(claims), (Table("The laws", header, tuple(rows)),))


def _log_odds(run: Mapping[str, Any]) -> dict[str, float]:
    """Of each law against all others together, after the last experiment; empty for a single law."""
    weights = run["experiments"][-1].get("log_odds") or {}
    found = {}
    for law, weight in weights.items():
        rest = [other for name, other in weights.items() if name != law]
        found[law] = weight - float(np.logaddexp.reduce(rest))
    return found


def shares(runs: Sequence[Mapping[str, Any]], right: str) -> tuple[float, float]:
    """The shares of runs that end at 20 : 1 or more for the right law, and for a wrong one."""
    odds = [_log_odds(run) for run in runs]
    found = [each.get(right, -np.inf) >= DECIDED for each in odds]
    wrong = [any(value >= DECIDED for law, value in each.items() if law != right) for each in odds]
    return float(np.mean(found)), float(np.mean(wrong))


def _errors(runs: Sequence[Mapping[str, Any]]) -> dict[str, list[float]]:
    """|error| in percent by parameter, of the runs whose last law has it."""
    found: dict[str, list[float]] = {}
    for run in runs:
        for name, error in run["experiments"][-1]["errors"].items():
            found.setdefault(name, []).append(abs(float(error)))
    return found


def _row(name: str, group: tuple[str, str, float, str | None], runs: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    policy, world, scale, law = group
    found, wrong = shares(runs, RIGHT[world]) if law else (np.nan, np.nan)
    errors = _errors(runs)
    inside = [all(run["experiments"][-1]["inside"]) for run in runs]
    return (
        f"{name}, {policy}",
        law or "its own",
        world,
        f"{100 * (scale - 1):+.0f} %",
        f"{len(runs)}",
        "" if np.isnan(found) else f"{found:.2f}",
        "" if np.isnan(wrong) else f"{wrong:.2f}",
        ", ".join(f"{which} {np.median(values):.1f}" for which, values in errors.items()),
        ", ".join(f"{np.percentile(values, 95):.1f}" for values in errors.values()),
        f"{np.mean(inside):.2f}",
    )


def _claims(name: str, group: tuple[str, str, float, str | None], runs: Sequence[dict[str, Any]]) -> list[Claim]:
    policy, world, scale, law = group
    if policy != "contact-aware" or law != "all":
        return []
    found, wrong = shares(runs, RIGHT[world])
    where = f"{name}, world {world}, prior {100 * (scale - 1):+.0f} %"
    if world == "model":
        kept = float(np.mean([run["experiments"][-1].get("law") == RIGHT[world] for run in runs]))
        return [require(f"{where}: share that keeps the right law", kept, 0.98)]
    claims = []
    if name == "pinching":
        claims.append(require(f"{where}: share that finds the right law", found, 0.95))
    if name != "hefting":  # a ball that rests in a hand says nothing of it
        claims.append(require(f"{where}: share that finds a wrong law", wrong, 0.01, at_most=True))
    errors = _errors(runs)
    for parameter, bound in MEDIAN[name].items():
        # a run that ended with another law has not found this parameter
        values = errors.get(parameter, []) + [np.inf] * (len(runs) - len(errors.get(parameter, [])))
        middle = float(np.median(values))
        claims.append(require(f"{where}: median error of {parameter}, %", middle, bound, at_most=True))
    inside = np.array([run["experiments"][-1]["inside"] for run in runs]).mean(axis=0)
    for share, which in zip(inside, errors, strict=False):
        claims.append(require(f"{where}: coverage of {which}", float(share), COVERAGE[name]))
    return claims
