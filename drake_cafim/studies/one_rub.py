"""Study `one-rub`: belief and information over time within one rub of the wall (the paper's second figure)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.experiment.closed_loop import Options, RunResult, run
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.curves import COLOURS
from drake_cafim.studies.findings import Claim, Findings
from drake_cafim.tasks.rubbing import TRUE_FRICTION, rubbing
from drake_cafim.typing import Array


def one_rub_cells(short: bool) -> list[Cell]:
    """No cells: its one run is carried out with the figure."""
    return []


def one_rub(results: Mapping[Cell, Any]) -> Findings:
    """The belief after every fifth step of one experiment, the force, and the information so far."""
    result = run_one_rub()
    about = (
        "One contact-aware rub, prior 30 % too high with a standard deviation of 1. The belief is updated every "
        "0.1 s from all samples so far."
    )
    return Findings(
        "Belief and information within one rub", about, tuple(one_rub_claims(result)), (), (_figure(result),)
    )


def run_one_rub(seed: int = 0) -> RunResult:
    """The result of one rubbing experiment with an estimate after every fifth step."""
    return run(replace(rubbing().with_prior_mean(1.3), estimate_every=5), Options(seed=seed, experiments=1))


def one_rub_claims(result: RunResult) -> list[Claim]:
    """Claims that the belief narrows only after contact, and faster while sliding faster."""
    (experiment,) = result.experiments
    time, mean, std = history(result)
    first = float(experiment.behaviour["first_contact"])
    before, after = std[time <= first], std[time > first]
    narrowed = float(after[-1] / result.prior.std[0])
    still = bool(np.allclose(before, result.prior.std[0]))
    gained = np.diff(information(std), prepend=information(std)[:1])
    speed = np.abs(experiment.robot_states[1:, 3]).reshape(-1, 5).mean(axis=1)
    normal = experiment.true_force[:, 0].reshape(-1, 5)
    touching = (normal > 0).any(axis=1)
    slow, fast = (gained[touching & side].mean() for side in (speed < np.median(speed), speed >= np.median(speed)))
    return [
        _claim(
            "Nothing is learned before contact, and contact narrows the belief",
            f"std {result.prior.std[0]:g} until {first:.2f} s, {after[-1]:.3f} after {time[-1]:g} s "
            f"({100 * narrowed:.1f} % of it); friction {mean[-1]:.3f}, truth {TRUE_FRICTION:g}",
            still and narrowed < 0.1,
        ),
        _claim(
            "It is sliding that informs",
            f"information a tenth of a second in contact: {fast:.3g} while faster, {slow:.3g} while slower than usual",
            bool(fast > slow),
        ),
    ]


def history(result: RunResult) -> tuple[Array, Array, Array]:
    """Times (N,) s, and mean and std (N,) of the friction after each update."""
    rows = result.experiments[0].history
    beliefs = [over_laws.beliefs[0] for _, over_laws in rows]
    time = np.array([time for time, _ in rows])
    return time, np.array([belief.mean[0] for belief in beliefs]), np.array([belief.std[0] for belief in beliefs])


def information(std: Array) -> Array:
    """1/variance, (N,)."""
    return np.asarray(std**-2.0)


def _claim(claim: str, found: str, holds: bool) -> Claim:
    return Claim(claim, found, "holds" if holds else "does not hold")


def _figure(result: RunResult) -> str:
    (experiment,) = result.experiments
    time, mean, std = history(result)
    with page_style():
        figure = Figure(figsize=(7.2, 4.6), layout="constrained")
        belief, inverse_variance, force = np.atleast_1d(figure.subplots(3, sharex=True))
        belief.fill_between(time, mean - 1.96 * std, mean + 1.96 * std, color=COLOURS[0], alpha=0.2, linewidth=0)
        belief.plot(time, mean, color=COLOURS[0])
        belief.axhline(TRUE_FRICTION, color="black", linewidth=0.8)
        belief.set_ylim(0.0, 1.2)
        belief.set_ylabel("friction")
        inverse_variance.plot(time, information(std), color=COLOURS[1])
        inverse_variance.set_ylabel("1/variance")
        for column, colour, label in zip(experiment.true_force.T, COLOURS[2:], ("normal", "tangential"), strict=False):
            force.step(experiment.time[1:], column, where="pre", color=colour, linewidth=1.0, label=label)
        force.set_ylabel("force, N")
        force.set_xlabel("time, s")
        force.legend(fontsize=7)
        return as_svg(figure, "Belief, information and force within one rub")
