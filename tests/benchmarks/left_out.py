"""`python -m tests.benchmarks.left_out DATA --out DIR`: each recording of the real machines left out in turn.

DATA is the folder of the sets. Each cut is diagnosed by the command, and its report stays in DIR: a second call makes
what is missing. Printed are a row a cut and a row a machine. Errors are those of simulations over a second, or over
0.1 s where a joint leaves its range; stated are the geometric means over coordinates of their ratios, of the corrected
model's to those of the model as given and of that with its unknowns alone. Of a machine they are pooled over its cuts,
root mean square by coordinate; −ln likelihoods are means over cuts.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import yaml

from tests.concealed.machines import SETS

FOLDS = 4
"""Of the thrown body's recordings, which are too many to leave out one by one."""
SECONDS = {
    "emps_drive": 40,
    "simple_pendulum": 60,
    "double_pendulum_A0": 150,
    "double_pendulum_C1": 150,
    "kuka_lwr4": 350,
    "panda_gaz2019": 450,
    "cube_toss": 300,
}
"""s of one core that a cut takes, roughly: for the word beforehand."""
MODELS = ("nominal_as_given", "nominal", "corrected")
ALL_INERTIALS = [{"parameter": "inertials", "body": "all", "std": 0.2}]


@dataclass(frozen=True)
class Cut:
    """The recordings `held` out of a machine's `runs`, and the folder of the report."""

    machine: str
    runs: Sequence[Path]
    held: Sequence[Path]
    out: Path

    @property
    def report(self) -> dict[str, Any] | None:
        """What was told of it; None where it is still to be made."""
        file = self.out / "report.json"
        return json.loads(file.read_text()) if file.exists() else None


def cuts_of(data: Path, name: str, out: Path) -> list[Cut]:
    """The cuts of a machine: each recording alone, or `FOLDS` of a thrown body's."""
    own = SETS[name]
    every = [data / name / "runs" / f"{run}.parquet" for run in (*own.train, *own.held)]
    groups = [[run] for run in every]
    if own.thrown:
        every = sorted((data / name / "runs").glob("*.parquet"))
        groups = [every[k::FOLDS] for k in range(FOLDS)]
    return [Cut(name, every, held, out / name / f"without_{held[0].stem}") for held in groups]


def scenario_of(data: Path, name: str, out: Path) -> Path:
    """The set's scenario, with what its README knows of the channels, in the folder of its reports."""
    folder = data / name
    scenario = yaml.safe_load((folder / "scenario.yaml").read_text())
    scenario["model"] = str(folder / scenario["model"])
    scenario["channels"] |= dict(SETS[name].published or {})
    if name == "panda_gaz2019":
        scenario["unknown"] = ALL_INERTIALS
    path = out / name / "scenario.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(scenario, sort_keys=False))
    return path


def diagnose(cut: Cut, scenario: Path) -> str:
    """Makes the report of a cut where there is none, and says how long that took."""
    if cut.report is not None:
        return f"{cut.out}: kept"
    began = time.monotonic()
    train = [run for run in cut.runs if run not in cut.held]
    command = [sys.executable, "-c", "from drake_cafim.cli import run_cli; run_cli()", "diagnose", scenario]
    command += ["--recording", *train, "--held-out", *cut.held, "--out", cut.out, "--no-replay", "--overwrite"]
    done = subprocess.run([*map(str, command), "--jobs", "1"], capture_output=True, text=True, check=False)
    words = "" if done.returncode == 0 else f" exit status {done.returncode}: {done.stderr[-300:]}"
    return f"{cut.out}: {time.monotonic() - began:.0f} s{words}"


def errors_of(report: dict[str, Any]) -> dict[str, dict[str, float]]:
    """By model the errors of simulations by coordinate, over a second where nothing leaves its range."""
    held = report["fit"]["held_out"]
    diverges = any(held[model].get("diverges") for model in MODELS)
    found = {}
    for model in MODELS:
        errors = held[model]["rmse_short" if diverges else "rmse"] or {}
        found[model] = {
            name: value
            for name, value in errors.items()
            if name.split(".")[0] not in ("v", "u", "wrench") and value is not None
        }
    return found


def ratio(errors: Sequence[dict[str, dict[str, float]]], model: str) -> float:
    """Geometric mean over coordinates of the corrected model's error over that of `model`, pooled over cuts."""
    names = set.intersection(*(set(own[kind]) for own in errors for kind in (model, "corrected")))
    pooled = {
        kind: np.array([np.sqrt(np.mean([own[kind][name] ** 2 for own in errors])) for name in sorted(names)])
        for kind in (model, "corrected")
    }
    return float(np.exp(np.mean(np.log(pooled["corrected"] / pooled[model])))) if names else float("nan")


def row(title: str, reports: Sequence[dict[str, Any]]) -> str:
    """A row of the table: likelihoods as given, with unknowns, corrected; ratios of errors; the names."""
    errors = [errors_of(report) for report in reports]
    losses = [np.mean([report["fit"]["held_out"][model]["nll"] for report in reports]) for model in MODELS]
    names = sorted({f"{item['effect']}@{item['at']}" for report in reports for item in report["explanation"]})
    ratios = " | ".join(f"{ratio(errors, model):.3f}" for model in MODELS[:2])
    told = f"{len(names)}: {', '.join(names)}" if len(reports) == 1 else f"{len(names)} in all"
    return f"| {title} | {' | '.join(f'{loss:.4g}' for loss in losses)} | {ratios} | {told} |"


def main() -> None:
    """Make what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/left_out"))
    parser.add_argument("--machines", nargs="+", choices=list(SECONDS), default=list(SECONDS))
    parser.add_argument("--jobs", type=int, default=1, help="diagnoses at a time, each of one process")
    options = parser.parse_args()
    data, out = options.data.resolve(), options.out.resolve()
    cuts = {name: cuts_of(data, name, out) for name in options.machines}
    new = [cut for name in cuts for cut in cuts[name] if cut.report is None]
    minutes = sum(SECONDS[cut.machine] for cut in new) / 60.0
    print(
        f"{len(new)} cuts are to be made, about {minutes:.0f} minutes of one core; the others are in {out}", flush=True
    )
    scenarios = {name: scenario_of(data, name, out) for name in cuts}
    calls = (joblib.delayed(diagnose)(cut, scenarios[cut.machine]) for cut in new)
    for words in joblib.Parallel(options.jobs, return_as="generator")(calls):
        print(words, flush=True)
    print("| left out | −ln L as given | with unknowns | corrected | error / as given | / with unknowns | named |")
    print("|---|---|---|---|---|---|---|")
    for name, own in cuts.items():
        reports = [(cut, report) for cut in own if (report := cut.report) is not None]
        for cut, report in reports:
            print(row(f"{name}, {cut.held[0].stem}", [report]))
        if reports:
            print(row(f"{name}, pooled", [report for _, report in reports]))


if __name__ == "__main__":
    main()
