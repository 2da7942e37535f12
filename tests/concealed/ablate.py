"""`python -m tests.concealed.ablate --data DIR --out DIR`: sealed ablations of real machines.

Each set is diagnosed once as it is; the corrected scenario is what is known of the machine. Then something known is
taken out of the model or put wrong into the recordings, its kind, place and strength drawn from the system's entropy
and sealed by a salted hash that is printed before the diagnosis starts. `ablations.json` holds what was found; without
any alteration, as a control, nothing new should be.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from tqdm import tqdm

from . import ablation
from .ablation import Ablation, Machine
from .case import Case
from .score import NORMAL_95, same_place
from .seal import Seal
from .trial import diagnosed

Draw = Callable[[Machine, np.random.Generator], Ablation]

SETS: Mapping[str, tuple[Sequence[str], Sequence[str]]] = {
    "emps_drive": (("ident_0", "ident_1"), ("ident_2",)),
    "double_pendulum_A0": (("trajectory_00", "trajectory_02", "trajectory_04"), ("trajectory_03",)),
}
"""Recordings of each set to learn from, and held out."""


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _pendulum_joint(rng: np.random.Generator) -> str:
    return str(rng.choice(["shoulder", "elbow"]))


def _lost_mass(machine: Machine, rng: np.random.Generator) -> Ablation:
    """A point that the link can spare: drawn until the rest is a rigid body, away from the centre of mass.

    At the centre of mass it would be the link's own mass, which the scenario says may be wrong.
    """
    body, low, high, center = [("upper_link", -0.4, -0.1, -0.275), ("lower_link", -0.35, 0.0, -0.166)][
        int(rng.integers(2))
    ]
    while True:
        place = np.array([0.0, 0.0, rng.uniform(low, high)])
        if abs(place[2] - center) < 0.08:
            continue
        try:
            return ablation.lost_mass(machine, body, float(rng.uniform(0.1, 0.3)), place)
        except ValueError:
            continue


def _lost_effect(machine: Machine, rng: np.random.Generator) -> Ablation:
    effects: list[dict[str, Any]] = machine.scenario["effects"]  # type: ignore[assignment]
    friction = [index for index, effect in enumerate(effects) if "friction" in effect["effect"]]
    return ablation.lost_effect(machine, int(rng.choice(friction)))


DRAWS: Sequence[tuple[str, Draw]] = (
    ("emps_drive", _lost_effect),
    ("emps_drive", lambda m, rng: ablation.late_actuator(m, "carriage", rng.uniform(0.003, 0.02))),
    ("emps_drive", lambda m, rng: ablation.biased_actuator(m, "carriage", _sign(rng) * rng.uniform(4.0, 20.0))),
    ("emps_drive", lambda m, rng: ablation.weak_actuator(m, "carriage", float(rng.choice([0.6, 0.7, 1.4, 1.6])))),
    ("double_pendulum_A0", _lost_mass),
    ("double_pendulum_A0", _lost_mass),
    ("double_pendulum_A0", _lost_effect),
    ("double_pendulum_A0", lambda m, rng: ablation.late_actuator(m, _pendulum_joint(rng), rng.uniform(0.02, 0.05))),
    ("double_pendulum_A0", lambda m, rng: ablation.weak_actuator(m, _pendulum_joint(rng), rng.uniform(0.4, 0.65))),
    (
        "double_pendulum_A0",
        lambda m, rng: ablation.biased_actuator(m, _pendulum_joint(rng), _sign(rng) * rng.uniform(0.3, 0.8)),
    ),
    (
        "double_pendulum_A0",
        lambda m, rng: ablation.biased_sensor(m, f"q.{_pendulum_joint(rng)}", _sign(rng) * rng.uniform(0.08, 0.25)),
    ),
    (
        "double_pendulum_A0",
        lambda m, rng: ablation.wrong_sensor_gain(
            m, f"v.{_pendulum_joint(rng)}", float(rng.choice([0.8, 0.9, 1.1, 1.25]))
        ),
    ),
    (
        "double_pendulum_A0",
        lambda m, rng: ablation.late_sensor(m, f"v.{_pendulum_joint(rng)}", rng.uniform(0.01, 0.03)),
    ),
    (
        "double_pendulum_A0",
        lambda m, rng: ablation.drifting_sensor(m, f"q.{_pendulum_joint(rng)}", _sign(rng) * rng.uniform(0.02, 0.06)),
    ),
)
"""What is sealed: the kind by slot; place and strength are drawn."""


def raw_machine(data: Path, name: str) -> Machine:
    """A set as it was published."""
    folder = data / name
    scenario = yaml.safe_load((folder / "scenario.yaml").read_text())
    train, held = SETS[name]
    names = [f"train_{k}.parquet" for k in range(len(train))] + [f"held_{k}.parquet" for k in range(len(held))]
    tables = {
        alias: pd.read_parquet(folder / "runs" / f"{run}.parquet")
        for alias, run in zip(names, (*train, *held), strict=True)
    }
    return Machine(scenario, (folder / str(scenario["model"])).read_text(), tables)


def known_machine(machine: Machine, diagnose: list[str], limit: float) -> Machine:
    """The machine with what a diagnosis of its own recordings finds, as its corrected scenario says it."""
    home = Path(tempfile.mkdtemp(prefix="known-"))
    try:
        report, failure = _diagnosed(machine, "known", diagnose, home, limit)
        if report is None:
            raise SystemExit(f"the machine as it is could not be diagnosed: {failure}")
        scenario = yaml.safe_load((home / "report" / "scenario.corrected.yaml").read_text())
        scenario["model"] = machine.scenario["model"]
        return ablation.as_fitted(Machine(scenario, machine.model, machine.tables))
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _diagnosed(
    machine: Machine, name: str, diagnose: list[str], home: Path, limit: float
) -> tuple[dict[str, Any] | None, str]:
    case = Case(
        "ablation", name, machine.scenario, str(machine.scenario["model"]), machine.model, dict(machine.tables), {}
    )
    case.write(home / name)
    return diagnosed(diagnose, home / name, home, limit, list(machine.tables))


def attempt(set_name: str, known: Machine, draw: Draw | None, diagnose: list[str], limit: float) -> dict[str, Any]:
    """One sealed ablation, or the control; the truth is told after the diagnosis has ended."""
    rng = np.random.default_rng(int.from_bytes(os.urandom(16), "big"))
    made = draw(known, rng) if draw else Ablation(known, "", "", {})
    seal = Seal.close({"effect": made.effect, "at": made.at, "parameters": dict(made.parameters)})
    print(f"sealed {seal.digest}", flush=True)
    home = Path(tempfile.mkdtemp(prefix="ablation-"))
    try:
        report, failure = _diagnosed(made.machine, "case", diagnose, home, limit)
    finally:
        shutil.rmtree(home, ignore_errors=True)
    return {"set": set_name, "digest": seal.digest, "salt": seal.salt, "truth": seal.truth} | scored(
        made, report, failure
    )


def scored(made: Ablation, report: dict[str, Any] | None, failure: str) -> dict[str, Any]:
    """What was named, whether it is what was concealed, and how far its first strength is off."""
    if report is None:
        return {"verdict": "failed", "failure": failure, "named": [], "found": False}
    named = [(item["effect"], item["at"]) for item in report["explanation"]]
    names = [(made.effect, made.at), *made.equal]
    found = [any(pair[0] == name and same_place(pair[1], at) for pair in named) for name, at in names]
    result = {
        "verdict": report["verdict"],
        "named": named,
        "found": any(found) if made.effect else not named,
        "rivals": [(item.get("effect") or item["parameter"], item["at"]) for item in report["rivals"]],
        "data_mistakes": report["data_mistakes"],
    }
    for item in report["explanation"]:
        if (item["effect"], item["at"]) == (made.effect, made.at) and made.parameters:
            first = next(name for name in made.parameters if name in item["parameters"])
            told, true = item["parameters"][first], made.parameters[first]
            result |= {
                "strength": {"name": first, "true": true, "told": told["value"], "std": told["std"]},
                "covered": abs(told["value"] - true) <= NORMAL_95 * told["std"],
            }
    fit = (report.get("fit") or {}).get("held_out") or {}
    if fit:
        result["held_out_rmse"] = {key: fit[key]["rmse"] for key in ("nominal", "corrected")}
    return result


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.ablate", description=__doc__)
    parser.add_argument("--data", type=Path, default=os.environ.get("DRAKE_CAFIM_DATA"), help="folder of the sets")
    parser.add_argument("--out", type=Path, default=Path("cafim-out/ablations"))
    parser.add_argument("--only", type=int, nargs="*", help="these slots only")
    parser.add_argument("--limit", type=float, default=600.0, help="s that one diagnosis may take")
    cafim = str(Path(sys.executable).parent / "cafim")
    parser.add_argument("--diagnose", nargs="+", default=[cafim, "diagnose", "--no-replay"])
    options = parser.parse_args(arguments)
    if options.data is None:
        raise SystemExit("--data or DRAKE_CAFIM_DATA must name the folder of the recorded sets")
    data = options.data / "data" if (options.data / "data").is_dir() else options.data
    wanted = range(len(DRAWS)) if options.only is None else options.only
    slots: list[tuple[str, Draw | None]] = [DRAWS[index] for index in wanted]
    sets = list(dict.fromkeys(name for name, _ in slots))
    known = {
        name: known_machine(raw_machine(data, name), options.diagnose, options.limit)
        for name in tqdm(sets, desc="machines as they are", file=sys.stderr)
    }
    slots += [(name, None) for name in sets]
    results = [
        attempt(name, known[name], draw, options.diagnose, options.limit)
        for name, draw in tqdm(slots, desc="ablations", file=sys.stderr)
    ]
    options.out.mkdir(parents=True, exist_ok=True)
    temporary = options.out / "ablations.part"
    temporary.write_text(json.dumps(results, indent=1, default=float) + "\n")
    temporary.replace(options.out / "ablations.json")
    for result in results:
        truth, strength = result["truth"], result.get("strength")
        told = ", ".join(f"{effect}@{at}" for effect, at in result["named"]) or result["verdict"]
        size = (
            f"; {strength['name']} {strength['told']:.4g} ± {strength['std']:.2g} of {strength['true']:.4g}"
            if strength
            else ""
        )
        concealed = f"{truth['effect']}@{truth['at']}" if truth["effect"] else "nothing"
        print(f"{'found' if result['found'] else 'MISSED':6}  {result['set']}: {concealed} -> {told}{size}")
    sealed = [result for result in results if result["truth"]["effect"]]
    print(f"{sum(result['found'] for result in sealed)} of {len(sealed)} found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
