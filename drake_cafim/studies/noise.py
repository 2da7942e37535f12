"""Study `noise`: errors and information of three policies, with the sensor's noise scaled by 0.1 to 3."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.design.policies import PolicyName
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.curves import COLOURS
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours, final_errors, information, ratio_of_medians

SIGMAS = (0.1, 0.3, 1.0, 3.0)
POLICIES: tuple[PolicyName, ...] = ("contact-aware", "finite-difference", "random")


def noise_cells(short: bool) -> list[Cell]:
    """Runs of three policies with the sensor's noise times 0.1 to 3, 20 seeds."""
    seeds = range(1 if short else 20)
    return [Cell(n, s, p, noise=sigma) for n in SCENARIOS for sigma in SIGMAS for p in POLICIES for s in seeds]


def noise(results: Mapping[Cell, Any]) -> Findings:
    """Final error against the noise, and whether contact-aware ties with random motions where it is small."""
    tables = tuple(_table(name, results) for name in SCENARIOS)
    quiet = min(SIGMAS)
    own, other = (information(_runs(results, "hefting", quiet, policy)) for policy in ("contact-aware", "random"))
    gain = ratio_of_medians(own, other)
    claim = Claim(
        "Hefting would tie with random if the sensor were less noisy",
        f"gain over random {gain} at {quiet:g} of the noise",
        "holds" if gain.alike else "does not hold",
    )
    about = (
        "The sensor's noise is scaled in the world and in the model; errors are medians over seeds of the mean over "
        "the unknowns. There is no force guard in this world, so random motions may exceed the force limit."
    )
    return Findings("Noise", about, (claim,), tables, (_figure(results),))


def _runs(results: Mapping[Cell, Any], name: str, sigma: float, policy: str) -> list[dict[str, Any]]:
    return [k for c, k in results.items() if (c.scenario, c.noise, c.policy) == (name, sigma, policy)]


def _table(name: str, results: Mapping[Cell, Any]) -> Table:
    rows = []
    for sigma in SIGMAS:
        by = [_runs(results, name, sigma, policy) for policy in POLICIES]
        errors = [f"{np.median(_errors(runs)):.2f}" for runs in by]
        own, *_, other = by
        forces = [f"{max(behaviours(runs, 'max_force')):.1f}" for runs in (own, other)]
        rows.append((f"{sigma:g}", *errors, str(ratio_of_medians(information(own), information(other))), *forces))
    header = ("noise", *(f"{policy}, %" for policy in POLICIES), "information over random")
    return Table(f"{name}: median final error", (*header, "largest force, N", "of random, N"), tuple(rows))


def _errors(runs: Sequence[dict[str, Any]]) -> Any:
    return final_errors(runs).mean(axis=1)


def _figure(results: Mapping[Cell, Any]) -> str:
    """Final error against the noise, a panel a scenario: medians and quartiles over seeds."""
    with page_style():
        figure = Figure(figsize=(7.2, 4.8), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        for axes, name in zip(panels.flat, SCENARIOS, strict=True):
            for policy, colour in zip(POLICIES, COLOURS, strict=False):
                errors = [_errors(_runs(results, name, sigma, policy)) for sigma in SIGMAS]
                low, middle, high = np.array([np.percentile(each, [25, 50, 75]) for each in errors]).T
                dashes = "--" if policy == "finite-difference" else "-"
                axes.fill_between(SIGMAS, low, high, color=colour, alpha=0.15, linewidth=0)
                axes.plot(SIGMAS, middle, dashes, color=colour, marker="o", markersize=3, label=policy)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xticks(SIGMAS, [f"{sigma:g}" for sigma in SIGMAS], minor=False)
            axes.set_title(f"{name}: final error, %")
        for axes in panels[1]:
            axes.set_xlabel("noise, times the scenario's")
        panels[0, 0].legend(fontsize=7)
        return as_svg(figure, "Final error against the noise of the sensor, for three policies in each scenario")
