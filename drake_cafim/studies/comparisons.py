"""Studies `convergence`, `planners` and `criteria`: policies, planners or criteria compared, all else equal."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from drake_cafim.design.planner import PlannerConfig, PlannerName
from drake_cafim.design.policies import PolicyName, make_planner
from drake_cafim.information import Criterion
from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.curves import Curve, quartile_figure
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, information, ratio_of_medians

POLICIES: tuple[PolicyName, ...] = get_args(PolicyName)
PLANNERS: tuple[PlannerName, ...] = get_args(PlannerName)
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)


def convergence_cells(short: bool) -> list[Cell]:
    """Runs of all six policies, 20 seeds."""
    return [Cell(name, seed, policy) for name in SCENARIOS for policy in POLICIES for seed in range(2 if short else 20)]


def convergence(results: Mapping[Cell, Any]) -> Findings:
    """Error and information by experiment for each policy, and what contact-awareness gains over each."""
    about = (
        "Six policies from the same prior, 30 % too high. Gains are ratios of median information, 95 % by bootstrap."
    )
    tables, claims, figures = [], [], []
    for name in SCENARIOS:
        by_policy = _groups(results, name, POLICIES, lambda cell: cell.policy)
        tables.append(_table(name, by_policy, "contact-aware"))
        claims += _policy_claims(name, by_policy)
        figures.append(_curves(name, by_policy))
    return Findings("Convergence", about, tuple(claims), tuple(tables), tuple(figures))


def policy_claims(results: Mapping[Cell, Any]) -> list[Claim]:
    """The paper's Q3: what contact-awareness gains in information and in error; `results` hold all six policies."""
    claims: list[Claim] = []
    for name in SCENARIOS:
        by_policy = _groups(results, name, POLICIES, lambda cell: cell.policy)
        claims += _policy_claims(name, by_policy)
    return claims


def planner_cells(short: bool) -> list[Cell]:
    """Runs of all four planners with about the same number of rollouts, 20 seeds."""
    seeds = range(1 if short else 20)
    return [Cell(name, seed, planner=planner) for name in SCENARIOS for planner in PLANNERS for seed in seeds]


def planners(results: Mapping[Cell, Any]) -> Findings:
    """Error, information and behaviour by planner, with about ten rollouts per step."""
    groups = {name: _groups(results, name, PLANNERS, lambda cell: cell.planner) for name in SCENARIOS}
    tables = tuple(_table(name, by, "predictive-sampling") for name, by in groups.items())
    about = f"The same score; rollouts a planning step: {rollouts_in_words()}."
    return Findings("Planners", about, (), tables)


def rollouts_in_words(axes: Sequence[int] = (1, 2)) -> str:
    """The number of rollouts of each planner per step, for motions along one axis and along two, in words."""
    config, found = PlannerConfig(), []
    for name in PLANNERS:
        counts = dict.fromkeys(str(make_planner(name, config).rollouts(config.knots * nu)) for nu in axes)
        found.append(f"{name} {' or '.join(counts)}")
    return ", ".join(found)


def criteria_cells(short: bool) -> list[Cell]:
    """Runs of all five criteria in the scenarios with two unknowns, 20 seeds."""
    seeds = range(1 if short else 20)
    names = ("pinching", "contouring")
    return [Cell(name, seed, criterion=criterion) for name in names for criterion in CRITERIA for seed in seeds]


def criteria(results: Mapping[Cell, Any]) -> Findings:
    """Error, information and condition number by criterion; condition numbers of F scaled by the truth."""
    names = ("pinching", "contouring")
    tables = [_table(name, _groups(results, name, CRITERIA, lambda cell: cell.criterion), "logdet") for name in names]
    about = "In units of the truth: F is scaled by θ before its condition number is taken."
    return Findings("Criteria", about, tuple(criteria_claims(results)), tuple(tables))


def criteria_claims(results: Mapping[Cell, Any]) -> list[Claim]:
    """Whether maximising the trace conditions F best; `results` hold all criteria for pinching and contouring."""
    claims = []
    for name in ("pinching", "contouring"):
        by = _groups(results, name, CRITERIA, lambda cell: cell.criterion)
        condition = {key: _condition(runs) for key, runs in by.items()}
        best = min(condition, key=lambda key: condition[key])
        found = ", ".join(f"{key} {value:.3g}" for key, value in condition.items())
        better = condition["trace"] <= 1.05 * condition[best]
        claims.append(
            Claim(
                f"{name}: maximising the trace gives the best condition number",
                found,
                "holds" if better else "does not hold",
            )
        )
    return claims


def _groups(
    results: Mapping[Cell, Any], scenario: str, names: Sequence[str], of: Callable[[Cell], str]
) -> dict[str, list[dict[str, Any]]]:
    return {
        name: [kept for cell, kept in results.items() if cell.scenario == scenario and of(cell) == name]
        for name in names
    }


def _table(scenario: str, groups: Mapping[str, Sequence[dict[str, Any]]], reference: str) -> Table:
    """Final error, information and behaviour of each group, and the reference's gain over it."""
    first = next(iter(groups.values()))[0]
    header = ("", *(f"error of {name}, %" for name in first["parameters"]), "information", f"{reference} over it")
    header = (*header, "condition", "contact", "airborne", "largest force, N", "planning, ms")
    rows = []
    for name, runs in groups.items():
        medians = np.median(final_errors(runs), axis=0)
        gain = "1" if name == reference else str(ratio_of_medians(information(groups[reference]), information(runs)))
        rows.append(
            (
                name,
                *(f"{value:.2f}" for value in medians),
                f"{np.median(information(runs)):.4g}",
                gain,
                f"{_condition(runs):.3g}",
                f"{np.mean(behaviours(runs, 'contact_fraction')):.2f}",
                f"{np.mean(behaviours(runs, 'airborne_fraction')):.2f}",
                f"{np.max(behaviours(runs, 'max_force')):.1f}",
                f"{np.median([experiment['planning_ms'] for run in runs for experiment in run['experiments']]):.2f}",
            )
        )
    return Table(f"{scenario}: {len(next(iter(groups.values())))} seeds", header, tuple(rows))


def _condition(runs: Sequence[dict[str, Any]]) -> float:
    """Median condition number of an experiment's information; infinite where it is singular."""
    values = [experiment["condition"] for run in runs for experiment in run["experiments"]]
    return float(np.median([np.inf if value is None else value for value in values]))


def _policy_claims(scenario: str, groups: Mapping[str, Sequence[dict[str, Any]]]) -> list[Claim]:
    claims = []
    own = information(groups["contact-aware"])
    errors = final_errors(groups["contact-aware"]).mean(axis=1)
    for other in POLICIES[1:]:
        gain = ratio_of_medians(own, information(groups[other]))
        less = ratio_of_medians(final_errors(groups[other]).mean(axis=1).tolist(), errors.tolist())
        claims += [
            Claim(f"Q3: {scenario}: contact-aware brings more information than {other}", str(gain), gain.standing),
            Claim(f"Q3: {scenario}: contact-aware ends with less error than {other}", str(less), less.standing),
        ]
    return claims


def _curves(scenario: str, groups: Mapping[str, Sequence[dict[str, Any]]]) -> str:
    curves = [
        Curve(
            name,
            np.array(
                [
                    [np.abs(run["prior_error"]).mean(), *(np.abs(e["error"]).mean() for e in run["experiments"])]
                    for run in runs
                ]
            ),
            np.array([np.cumsum([e["information"] for e in run["experiments"]]) for run in runs]),
        )
        for name, runs in groups.items()
    ]
    return quartile_figure(scenario, curves)
