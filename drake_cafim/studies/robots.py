"""Study `worlds`: all four scenarios with their robots in Drake's hydroelastic contact."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from drake_cafim.design.policies import PolicyName
from drake_cafim.numerics.rounding import short
from drake_cafim.studies.cell import SCENARIOS, TASKS, Cell
from drake_cafim.studies.findings import (
    Claim,
    Findings,
    Table,
    behaviours,
    final_errors,
    information,
    require,
)

# the cheapest first, so that an interrupted study lacks only the most expensive runs
ORDER = ("contouring", "pinching", "rubbing", "hefting")
LIMITED = ("contouring", "pinching")  # scenarios with a force limit
OTHERS: Mapping[PolicyName, int] = {"finite-difference": 10, "asid": 10, "scripted": 1}
"""Number of seeds of the other policies, run for their forces; the scripted motion does not depend on the seed."""


def world_cells(short: bool) -> list[Cell]:
    """Contact-aware from 40 seeds, from 20 with a prior 30 % too low, random from 20.

    Where the force is limited, these are with the force guard; runs without it, and of `OTHERS`, show their forces.
    """
    some, many = (range(1), range(1)) if short else (range(20), range(40))
    cells = []
    for name in ORDER:
        cells += [Cell(name, seed, world="drake") for seed in many]
        cells += [Cell(name, seed, "random", world="drake") for seed in some]
        cells += [Cell(name, seed, prior_scale=0.7, world="drake") for seed in some]
        if name in LIMITED:
            cells += [Cell(name, seed, world="drake", force_guard=False) for seed in some[:10]]
            others = ((policy, seed) for policy, count in OTHERS.items() for seed in some[:count])
            cells += [Cell(name, seed, policy, world="drake") for policy, seed in others]
    return cells


BEHAVIOUR: Mapping[str, Mapping[str, str]] = {
    "hefting": {"airborne": "airborne_fraction", "reversals": "reversals"},
    "rubbing": {"contact": "contact_fraction", "sliding": "sliding_fraction"},
    "pinching": {"contact": "contact_fraction", "makes and breaks": "make_breaks"},
    "contouring": {"contact": "contact_fraction", "faces touched": "faces"},
}
"""What is counted in each scenario: a column's header, and the kind of behaviour whose mean it shows."""

Group: TypeAlias = tuple[PolicyName, float, bool | None]
"""Policy, prior over the truth, and whether the force guard cut the commands; None, the default."""


def worlds(results: Mapping[Cell, Any]) -> Findings:
    """A table for each scenario, and claims on hydroelastic contact, the force limit and the planning time."""
    tables, claims = [], []
    for name in SCENARIOS:
        groups: dict[Group, list[dict[str, Any]]] = {}
        for cell, kept in results.items():
            if cell.scenario == name:
                groups.setdefault((cell.policy, cell.prior_scale, cell.force_guard), []).append(kept)
        tables.append(_table(name, groups))
        claims += _claims(name, groups)
    about = (
        "Arm, gripper and hand follow the plans by joint control; the touched objects are compliant, in Drake's "
        "hydroelastic contact, which is not the planner's law. Errors are medians, with the 95th percentile in "
        "parentheses; intervals are at 95 %; behaviour is the mean over experiments; forces are the true ones, at "
        "every step of the plant."
    )
    return Findings("The scenarios with robots, in hydroelastic contact", about, tuple(claims), tuple(tables))


def _table(name: str, groups: Mapping[Group, Sequence[dict[str, Any]]]) -> Table:
    parameters = next(iter(groups.values()))[0]["parameters"]
    limit = force_limit(name)
    header = (
        "policy, prior",
        "seeds",
        *(f"error of {parameter}, %" for parameter in parameters),
        "interval holds",
        "information",
    )
    header = (*header, *BEHAVIOUR[name], "largest force, N", *(() if limit is None else ("over the limit",)))
    header = (*header, "tracking, m/s", "planning, ms")
    rows = []
    for group, runs in groups.items():
        flat = [experiment for run in runs for experiment in run["experiments"]]
        inside = np.mean([run["experiments"][-1]["inside"] for run in runs], axis=0)
        forces = np.array(behaviours(runs, "max_force"))
        rows.append(
            (
                _group_name(group),
                f"{len(runs)}",
                *(f"{np.median(column):.1f} ({np.percentile(column, 95):.1f})" for column in final_errors(runs).T),
                ", ".join(f"{share:.2f}" for share in inside),
                short(float(np.median(information(runs))), 3),
                *(
                    f"{np.mean([_number(count) for count in behaviours(runs, k)]):.2f}"
                    for k in BEHAVIOUR[name].values()
                ),
                f"{forces.max():.1f}",
                *(() if limit is None else (f"{int((forces > limit).sum())} of {len(forces)}",)),
                f"{np.median([experiment['tracking_error'] for experiment in flat]):.3f}",
                f"{np.median([experiment['planning_ms'] for experiment in flat]):.2f}",
            )
        )
    return Table(name, header, tuple(rows))


def _group_name(group: Group) -> str:
    policy, scale, guarded = group
    sign = "+" if scale > 1 else "−"
    return f"{policy}{' unguarded' if guarded is False else ''}, {sign}{abs(100 * (scale - 1)):.0f} %"


def _number(behaviour: Any) -> float:
    """A behaviour as a number: of a list, such as the faces touched, its length."""
    return float(len(behaviour) if isinstance(behaviour, list) else behaviour)


def force_limit(name: str) -> float | None:
    """The largest force N that a scenario allows, None where it names none."""
    limit = getattr(TASKS[name]().model, "force_limit", None)
    return None if limit is None else float(limit)


def _claims(name: str, groups: Mapping[Group, Sequence[dict[str, Any]]]) -> list[Claim]:
    by_prior = {group: runs for group, runs in groups.items() if group[0] == "contact-aware" and group[2] is None}
    own = [run for runs in by_prior.values() for run in runs]
    flat = [experiment for run in own for experiment in run["experiments"]]
    shares = [0.0 if experiment["hydroelastic"] is None else float(experiment["hydroelastic"]) for experiment in flat]
    period = 1e3 * float(own[0]["period"])
    planning = float(np.median([experiment["planning_ms"] for experiment in flat]))
    claims = [
        require(f"{name}: smallest share of hydroelastic among steps in contact", min(shares), 1.0),
        require(f"{name}: median planning step, ms", planning, period, at_most=True),
    ]
    limit = force_limit(name)
    if limit is not None:
        for group, runs in by_prior.items():
            largest = max(behaviours(runs, "max_force"))
            claims.append(require(f"{name}: largest true force, {_group_name(group)}, N", largest, limit, at_most=True))
    return claims
