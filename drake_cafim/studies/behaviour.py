"""Study `behaviour`: contacts, reversals and touched faces of informative motions, for the paper's Q1 and Q2."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_cafim.studies.cell import SCENARIOS, Cell
from drake_cafim.studies.findings import Claim, Findings, Table, behaviours
from drake_cafim.studies.time_series import time_series

COUNTS = ("contact_fraction", "sliding_fraction", "airborne_fraction", "reversals", "make_breaks")


def behaviour_cells(short: bool) -> list[Cell]:
    """Runs of contact-aware and of random in every scenario, 20 seeds."""
    seeds = range(1 if short else 20)
    return [Cell(name, seed, policy) for name in SCENARIOS for policy in ("contact-aware", "random") for seed in seeds]


def behaviour(results: Mapping[Cell, Any]) -> Findings:
    """Counts of an experiment's contacts, mean over experiments and seeds, and a run of each scenario over time."""
    mean = _means(results)
    rows = [
        (f"{name}, {policy}", *(f"{value:.2f}" for value in found.values())) for (name, policy), found in mean.items()
    ]
    table = Table("Counts of one experiment", ("", *COUNTS, "faces"), tuple(rows))
    about = "The objective holds only information and the costs of force and of leaving contact."
    figures = tuple(time_series(name) for name in SCENARIOS)
    return Findings("Emergent behaviour", about, tuple(_answers(mean)), (table,), figures)


def behaviour_claims(results: Mapping[Cell, Any]) -> list[Claim]:
    """The paper's Q1 and Q2, answered by counts; `results` hold contact-aware and random runs of all scenarios."""
    return _answers(_means(results))


def _means(results: Mapping[Cell, Any]) -> dict[tuple[str, str], dict[str, float]]:
    mean = {}
    for name in SCENARIOS:
        for policy in ("contact-aware", "random"):
            runs = [kept for cell, kept in results.items() if cell.scenario == name and cell.policy == policy]
            found = {count: float(np.mean(behaviours(runs, count))) for count in COUNTS}
            found["faces"] = float(np.mean([len(faces) for faces in behaviours(runs, "faces")]))
            mean[name, policy] = found
    return mean


def _answers(mean: Mapping[tuple[str, str], Mapping[str, float]]) -> list[Claim]:
    heft, rub = mean["hefting", "contact-aware"], mean["rubbing", "contact-aware"]
    pinch, contour = mean["pinching", "contact-aware"], mean["contouring", "contact-aware"]
    return [
        _claim(
            "Q1: hefting keeps contact and reverses",
            f"airborne {heft['airborne_fraction']:.3f}, {heft['reversals']:.1f} reversals",
            heft["airborne_fraction"] <= 0.05 and heft["reversals"] >= 6,
        ),
        _claim(
            "Q1: rubbing keeps constant, sliding contact",
            f"contact {rub['contact_fraction']:.2f}, sliding {rub['sliding_fraction']:.2f}",
            rub["contact_fraction"] >= 0.85 and rub["sliding_fraction"] >= 0.7,
        ),
        _claim(
            "Q2: pinching makes and breaks contact",
            f"{pinch['make_breaks']:.1f} changes an experiment",
            pinch["make_breaks"] >= 6,
        ),
        _claim(
            "Q2: contouring makes and breaks contact and touches several sides",
            f"{contour['make_breaks']:.1f} changes, {contour['faces']:.1f} faces",
            contour["make_breaks"] >= 4 and contour["faces"] >= 2,
        ),
    ]


def _claim(claim: str, found: str, holds: bool) -> Claim:
    return Claim(claim, found, "holds" if holds else "does not hold")
