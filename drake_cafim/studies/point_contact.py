"""Study `point-contact`: estimates in Drake's compliant point contact, by its own law and by the paper's."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drake_cafim.studies.cell import POINT, Cell
from drake_cafim.studies.findings import Claim, Findings, Table, final_errors, require
from drake_cafim.tasks.pinching import TRUE_STIFFNESS
from drake_cafim.typing import Array

LACKING = "contact_hunt_crossley_dissipation"


def point_contact_cells(short: bool) -> list[Cell]:
    """20 seeds in each world, and one run whose recordings are diagnosed."""
    seeds, experiments = (range(2), 2) if short else (range(20), None)
    # without the force guard: the study is on estimation, and the guard would change the motions
    bold = Cell(POINT, 0, experiments=experiments, force_guard=False)
    cells = [replace(bold, seed=seed, world=kind) for kind in ("drake", "model") for seed in seeds]
    return [*cells, replace(bold, world="drake", experiments=3, diagnosed=True)]


def point_contact(results: Mapping[Cell, Any]) -> Findings:
    """Errors with Drake's law in both worlds, the paper's law on the same data, and the diagnosis."""
    runs = {
        kind: [kept for cell, kept in results.items() if cell.world == kind and not cell.diagnosed]
        for kind in ("drake", "model")
    }
    errors = {kind: final_errors(kept) for kind, kept in runs.items()}
    parameters = runs["drake"][0]["parameters"]
    ratios = np.median(errors["drake"], axis=0) / np.median(errors["model"], axis=0)
    claims = [
        require(f"error of {name} in Drake's point contact over world model", float(ratio), 1.5, at_most=True)
        for name, ratio in zip(parameters, ratios, strict=True)
    ]
    claims += _of_laws(runs["drake"])
    (verdict,) = [kept["diagnosis"] for cell, kept in results.items() if cell.diagnosed]
    claims += _of_diagnosis(verdict)
    rows = tuple(
        (
            f"{kind}, {len(errors[kind])} seeds",
            *(f"{np.median(column):.2f} ({np.percentile(column, 95):.2f})" for column in errors[kind].T),
            ", ".join(f"{share:.2f}" for share in _coverage(runs[kind])),
        )
        for kind in ("drake", "model")
    )
    header = ("world", *(f"error of {name}, median (95 %), %" for name in parameters), "interval holds")
    about = (
        "A ball of Drake's compliant point contact, K = 800 N/m, dissipation 2.5 s/m, pinched by the gripper; the "
        "estimator has Hunt and Crossley's law. The other laws then estimate from the same data, all experiments but "
        "the last, and predict the last. The diagnosis has the paper's law as its nominal one. Its verdict: "
        f"{verdict['sentence']}"
    )
    tables = (Table("Drake's law", header, rows), _law_table(runs["drake"]))
    return Findings("Compliant point contact", about, tuple(claims), tables)


def _coverage(runs: Sequence[dict[str, Any]]) -> Array:
    return np.asarray(np.mean([run["experiments"][-1]["inside"] for run in runs], axis=0))


def _stiffness_errors(runs: Sequence[dict[str, Any]], law: str) -> Array:
    """(K̂ − K)/std of each run."""
    found = [(run["laws"][law]["estimate"]["stiffness"], run["laws"][law]["std"]["stiffness"]) for run in runs]
    return np.array([(estimate - TRUE_STIFFNESS) / std for estimate, std in found])


def _of_laws(runs: Sequence[dict[str, Any]]) -> list[Claim]:
    bias = {law: float(np.mean(_stiffness_errors(runs, law))) for law in ("paper", "hunt_crossley")}
    worse = np.array([run["laws"]["paper"]["held_out"] - run["laws"]["hunt_crossley"]["held_out"] for run in runs])
    damping = float(np.median([run["laws"]["paper"]["estimate"]["damping"] for run in runs]))
    held = bool(abs(bias["paper"]) > abs(bias["hunt_crossley"]) and damping < 1.0)
    said = (
        f"K off by {bias['paper']:+.2f} std on average ({bias['hunt_crossley']:+.2f} with Drake's law), "
        f"median damping {damping:.2g} N s/m instead of 10"
    )
    return [
        Claim("The paper's law on the same data is biased", said, "holds" if held else "does not hold"),
        require("χ² a sample of the held-out force, paper's law less Drake's", float(worse.mean()), 0.0),
    ]


def _of_diagnosis(verdict: Mapping[str, Any]) -> list[Claim]:
    named = [effect for effect in verdict["effects"] if effect["effect"] == LACKING]
    said = ", ".join(
        f"{effect['at']}: {value:.2f} ± {std:.2f} s/m" for effect in named for value, std in effect["values"].values()
    )
    before, after = verdict["nominal"]["nll"], verdict["corrected"]["nll"]
    return [
        Claim(f"The diagnosis names {LACKING}", said or "not named", "holds" if named else "does not hold"),
        require("held-out nll of the diagnosis, before less after", before - after, 0.0),
    ]


def _law_table(runs: Sequence[dict[str, Any]]) -> Table:
    rows = []
    for law in runs[0]["laws"]:
        found = [run["laws"][law] for run in runs]
        names = list(found[0]["estimate"])
        values = [f"{name} {np.median([estimate['estimate'][name] for estimate in found]):.4g}" for name in names]
        scaled = _stiffness_errors(runs, law)
        rows.append(
            (
                law,
                "; ".join(values),
                f"{scaled.mean():+.2f} ± {scaled.std() / np.sqrt(len(scaled)):.2f}",
                f"{np.mean(np.abs(scaled) < 1.96):.2f}",
                f"{np.mean([estimate['held_out'] for estimate in found]):.3f}",
            )
        )
    header = ("law", "median estimates", "error of K, std", "interval holds K", "χ² a sample, held out")
    return Table("Three laws on the same data", header, tuple(rows))
