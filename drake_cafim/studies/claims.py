"""Study `claims`: every claim of the paper, including its remarks and limitations, in one table with its standing."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.design.policies import PolicyName
from drake_cafim.studies.asides import aside_claims
from drake_cafim.studies.behaviour import behaviour_claims
from drake_cafim.studies.cell import SCENARIOS, Cell, select_varied
from drake_cafim.studies.comparisons import CRITERIA, POLICIES, criteria_claims, policy_claims
from drake_cafim.studies.disturbances import disturbance_cells, disturbance_claims
from drake_cafim.studies.findings import Claim, Findings, Ratio, Standing, final_errors, ratio_of_medians
from drake_cafim.studies.landscapes import landscape_claims
from drake_cafim.studies.one_rub import one_rub_claims, run_one_rub
from drake_cafim.studies.priors import prior_claims, robustness_cells

QUIET = 0.1  # times the sensor's noise
RIVALS: tuple[PolicyName, ...] = ("finite-difference", "asid", "random")
SEEDS = 10
"""Of each criterion and disturbance; the policies have twice as many, and the other studies more."""


def claim_cells(short: bool) -> list[Cell]:
    """40 seeds of each prior, 20 of each policy, 10 of criteria, disturbances, and hefting with a quiet sensor."""
    seeds, twice = range(1 if short else SEEDS), range(1 if short else 2 * SEEDS)
    cells = [Cell(name, seed, policy) for name in SCENARIOS for policy in POLICIES for seed in twice]
    cells += [Cell("hefting", seed, policy, noise=QUIET) for policy in ("contact-aware", *RIVALS) for seed in seeds]
    cells += disturbance_cells(short, len(seeds))
    cells += [Cell(n, seed, criterion=c) for n in ("pinching", "contouring") for c in CRITERIA for seed in seeds]
    return cells + robustness_cells(short)


def claims(results: Mapping[Cell, Any]) -> Findings:
    """The table; Q1 to Q4 are the paper's questions."""
    policies = select_varied(results, "policy")
    priors = select_varied(results, "prior_scale")
    found = [
        *behaviour_claims(policies),
        *policy_claims(policies),
        _pinching_gains_least(policies),
        *prior_claims(priors),
        *(Claim(f"Q4: {claim.claim}", claim.found, claim.standing) for claim in landscape_claims()),
        *one_rub_claims(run_one_rub()),
        *criteria_claims(select_varied(results, "criterion")),
        *aside_claims(),
        _over_approximates(priors),
        *_quiet_hefting(results),
        *disturbance_claims(results),
        _real_time(policies),
        *_beyond_reach(),
    ]
    about = (
        "Kinematic world: perfect tracking, the planner's own contact law. Ratios are of medians, with 95 % intervals; "
        "they tie within 0.8 and 1.25, and where the interval holds 1. Other studies have the tables and curves behind."
    )
    return Findings("What the paper claims", about, tuple(found))


def _errors(results: Mapping[Cell, Any], name: str, policy: str) -> list[float]:
    runs = [kept for cell, kept in results.items() if cell.scenario == name and cell.policy == policy]
    return list(final_errors(runs).mean(axis=1).tolist())


def _gain(results: Mapping[Cell, Any], name: str, policy: str) -> Ratio:
    """The ratio of median errors of `policy` and of contact-aware."""
    return ratio_of_medians(_errors(results, name, policy), _errors(results, name, "contact-aware"))


def _pinching_gains_least(policies: Mapping[Cell, Any]) -> Claim:
    gains = {name: _gain(policies, name, "asid") for name in SCENARIOS}
    least = min(gains, key=lambda name: gains[name].value)
    said = "error of asid over contact-aware: " + ", ".join(f"{name} {gain}" for name, gain in gains.items())
    return Claim(
        "Q3: pinching gains least over the baseline", said, "holds" if least == "pinching" else "does not hold"
    )


def _over_approximates(priors: Mapping[Cell, Any]) -> Claim:
    """Mean squared error over the claimed variance, from priors with the true mean; below 1 if that is too large."""
    squares = []
    for cell, kept in priors.items():
        if cell.prior_scale == 1.0:
            last = kept["experiments"][-1]
            squares.append(np.mean((np.array(last["error"]) / np.array(last["std"])) ** 2))
    mean, half = float(np.mean(squares)), 1.96 * float(np.std(squares) / np.sqrt(len(squares)))
    standing: Standing = "holds" if mean + half < 1.0 else "does not hold" if mean - half > 1.0 else "ties"
    said = f"squared error over claimed variance {mean:.2f} ± {half:.2f}, {len(squares)} runs from the true mean"
    return Claim("(F + Σ⁻¹)⁻¹ over-approximates the uncertainty", said, standing)


def _quiet_hefting(results: Mapping[Cell, Any]) -> list[Claim]:
    quiet = {cell: kept for cell, kept in select_varied(results, "policy", "noise").items() if cell.noise == QUIET}
    found = []
    for rival in RIVALS:
        gain = _gain(quiet, "hefting", rival)
        standing: Standing = "holds" if gain.alike else "does not hold"
        said = f"error of {rival} over contact-aware {gain} at {QUIET:g} of the noise"
        found.append(Claim(f"Hefting would tie with {rival} if the sensor were less noisy", said, standing))
    return found


def _real_time(policies: Mapping[Cell, Any]) -> Claim:
    said, holds = [], True
    for name in SCENARIOS:
        runs = [k for cell, k in policies.items() if cell.scenario == name and cell.policy == "contact-aware"]
        planning = float(np.median([experiment["planning_ms"] for run in runs for experiment in run["experiments"]]))
        period = 1e3 * float(runs[0]["period"])
        holds &= planning < period
        said.append(f"{name} {planning:.2f} of {period:g} ms")
    return Claim("Plans in real time", ", ".join(said), "holds" if holds else "does not hold")


def _beyond_reach() -> list[Claim]:
    reach = (
        (
            "The experiments on the paper's robots",
            "no hardware; robots of their kind in Drake: `cafim study worlds`",
        ),
        ("The paper's curves, point for point", "its time steps, noise and number of experiments are not published"),
    )
    return [Claim(claim, found, "cannot be repeated here") for claim, found in reach]
