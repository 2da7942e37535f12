"""`python -m tests.concealed.ablate --data DIR --out DIR [--resume]`: sealed ablations of seven real machines.

Each set is diagnosed once as it is; the corrected scenario is what is known of the machine. Then something known is
taken out of the model or put wrong into the recordings, its place and strength drawn from the system's entropy and
sealed by a salted hash that is printed before the diagnosis starts. Beside them stand controls, the machines without
any alteration, and real nulls: a machine is corrected on one half of its blocks and diagnosed on the other, where
nothing new may be named. Every finished slot is a file; a killed run goes on with --resume. `ablations.json` holds all
of them, `summary.json` the shares. It takes hours.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from joblib import Parallel, delayed
from tqdm import tqdm

from drake_cafim.effects.catalogue import EFFECTS

from . import ablation
from .ablation import Ablation, Machine
from .ablation_draws import Draw, slots
from .alike import NORMAL_95
from .case import Case
from .machines import SETS, divided, raw_machine
from .score import same_place
from .seal import Seal
from .trial import diagnosed

NULLS_PER_MACHINE = 9
FAMILY = {effect.name: effect.family for effect in EFFECTS} | {"mass": "link", "inertials": "link"}
Named = list[tuple[str, str]]


@dataclass(frozen=True)
class Work:
    """What every slot needs: the folder of the sets, that of the results, the command and its limit, s."""

    data: Path
    out: Path
    diagnose: list[str]
    limit: float

    def slot(self, name: str) -> Path:
        return self.out / "slots" / f"{name}.json"


def known_machine(machine: Machine, work: Work) -> tuple[Machine | None, str]:
    """The machine with what a diagnosis of its own recordings finds, as its corrected scenario says it; or why not."""
    home = Path(tempfile.mkdtemp(prefix="known-"))
    try:
        report, failure = _diagnosed(machine, "known", home, work)
        if report is None:
            return None, failure
        scenario = yaml.safe_load((home / "report" / "scenario.corrected.yaml").read_text())
        scenario["model"] = machine.scenario["model"]
        _keep_tables(scenario, home / "report", work.out.resolve() / "laws")
        return ablation.as_fitted(Machine(scenario, machine.model, machine.tables)), ""
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _keep_tables(scenario: Mapping[str, Any], folder: Path, kept: Path) -> None:
    """Copies the tables of learned forces from `folder` to `kept`, named by their content; the scenario names these."""
    for effect in scenario.get("effects", []):
        if "table" in effect:
            source = folder / effect["table"]
            kept.mkdir(parents=True, exist_ok=True)
            target = kept / f"{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}.parquet"
            effect["table"] = str(shutil.copyfile(source, target))


def _diagnosed(machine: Machine, name: str, home: Path, work: Work) -> tuple[dict[str, Any] | None, str]:
    case = Case(
        "ablation", name, machine.scenario, str(machine.scenario["model"]), machine.model, dict(machine.tables), {}
    )
    case.write(home / name)
    return diagnosed(work.diagnose, home / name, home, work.limit, list(machine.tables))


def keep_machine(machine: Machine, folder: Path) -> None:
    """Writes a machine, to be read by `kept_machine`."""
    temporary = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    (temporary / "model").write_text(machine.model)
    (temporary / "scenario.yaml").write_text(yaml.safe_dump(machine.scenario))
    for key, table in machine.tables.items():
        table.to_parquet(temporary / key, index=False)
    shutil.rmtree(folder, ignore_errors=True)
    temporary.rename(folder)


def kept_machine(folder: Path) -> Machine:
    tables = {path.name: pd.read_parquet(path) for path in sorted(folder.glob("*.parquet"))}
    return Machine(yaml.safe_load((folder / "scenario.yaml").read_text()), (folder / "model").read_text(), tables)


def attempt(name: str, set_name: str, kind: str, draw: Draw | None, work: Work) -> None:
    """One sealed ablation, or a control where there is nothing to draw; the truth is told after the diagnosis."""
    rng = np.random.default_rng(int.from_bytes(os.urandom(16), "big"))
    known = kept_machine(work.out / "known" / set_name)
    made = draw(known, rng) if draw else Ablation(known, "", "", {})
    seal = Seal.close({"effect": made.effect, "at": made.at, "parameters": dict(made.parameters)})
    _seal(work, seal.digest)
    home = Path(tempfile.mkdtemp(prefix="ablation-"))
    try:
        report, failure = _diagnosed(made.machine, secrets.token_hex(6), home, work)
    finally:
        shutil.rmtree(home, ignore_errors=True)
    opened = {"digest": seal.digest, "salt": seal.salt, "truth": seal.truth}
    _write(work.slot(name), {"set": set_name, "kind": kind} | opened | scored(made, report, failure))


def attempt_null(name: str, set_name: str, work: Work) -> None:
    """One real null: corrected on one half of the blocks, diagnosed on the other."""
    rng = np.random.default_rng(int.from_bytes(os.urandom(16), "big"))
    entry, other = divided(raw_machine(work.data, set_name), SETS[set_name].thrown, rng)
    corrected, failure = known_machine(entry, work)
    report = None
    if corrected is not None:
        home = Path(tempfile.mkdtemp(prefix="null-"))
        try:
            again = Machine(corrected.scenario, corrected.model, other.tables)
            report, failure = _diagnosed(again, secrets.token_hex(6), home, work)
        finally:
            shutil.rmtree(home, ignore_errors=True)
    _write(work.slot(name), {"set": set_name, "kind": "null"} | scored(Ablation(entry, "", "", {}), report, failure))


def _seal(work: Work, digest: str) -> None:
    """Tells the digest before the diagnosis starts."""
    with open(work.out / "seals.txt", "a") as stream:
        stream.write(f"{digest}\n")
    print(f"sealed {digest}", flush=True)


def _write(path: Path, result: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    _write_json(path, result)


def _write_json(path: Path, content: object) -> None:
    """JSON, there with all its lines or not at all."""
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps(content, indent=1, default=float) + "\n")
    temporary.replace(path)


def scored(made: Ablation, report: dict[str, Any] | None, failure: str) -> dict[str, Any]:
    """What was named, whether it is what was concealed, and how far its first strength is off."""
    if report is None:
        return {"verdict": "failed", "failure": failure, "named": [], "found": False, "family": False}
    named = [(item["effect"], item["at"]) for item in report["explanation"]]
    # a nominal parameter far from its prior is a finding, too
    named += [
        (word, location["name"])
        for location in report["mismatch"]["locations"]
        for word in ("mass", "inertials")
        if location["kind"] == "body" and f"{word} of {location['name']}" in report["sentence"].lower()
    ]
    names = [(made.effect, made.at), *made.equal]
    result = {
        "verdict": report["verdict"],
        "named": named,
        "truths": names,
        "found": any(_same(pair, own) for pair in named for own in names) if made.effect else not named,
        "family": any(_alike(pair, own) for pair in named for own in names) if made.effect else not named,
        "rivals": [(item.get("effect") or item["parameter"], item["at"]) for item in report["rivals"]],
        "data_mistakes": report["data_mistakes"],
    }
    for item in report["explanation"]:
        if (item["effect"], item["at"]) == (made.effect, made.at) and made.parameters:
            first = next(name for name in made.parameters if name in item["parameters"])
            told, true = item["parameters"][first], made.parameters[first]
            result |= {"strength": {"name": first, "true": true, "told": told["value"], "std": told["std"]}}
            if told["std"] is not None:
                result |= {"covered": abs(told["value"] - true) <= NORMAL_95 * told["std"]}
    fit = (report.get("fit") or {}).get("held_out") or {}
    if fit:
        result["held_out_rmse"] = {key: fit[key]["rmse"] for key in ("nominal", "corrected")}
    return result


def _same(pair: Sequence[str], own: Sequence[str]) -> bool:
    return pair[0] == own[0] and same_place(pair[1], own[1])


def _alike(pair: Sequence[str], own: Sequence[str]) -> bool:
    """Whether two names are of one family and one place, a joint's channels counting as the joint."""
    first, second = (place.split(".")[-1] if place[:2] in ("q.", "v.", "u.") else place for place in (pair[1], own[1]))
    return FAMILY.get(pair[0]) == FAMILY.get(own[0]) and same_place(first, second)


def summary(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Shares over all slots: found exactly, at their family and place, misnamed; nulls that name something; covered.

    What the control of a machine names, it also names without any alteration: that is neither found nor misnamed.
    """
    controls = {entry["set"]: entry["named"] for entry in results if entry["kind"] == "control"}
    sealed = [entry for entry in results if entry["kind"] not in ("control", "null")]
    nulls = [entry for entry in results if entry["kind"] == "null"]
    covered = [entry["covered"] for entry in sealed if "covered" in entry]

    def new(entry: Mapping[str, Any]) -> list[Sequence[str]]:
        before = controls.get(entry["set"], [])
        return [pair for pair in entry["named"] if not any(_same(pair, own) for own in before)]

    def matches(entry: Mapping[str, Any], alike: Callable[[Sequence[str], Sequence[str]], bool]) -> bool:
        return any(alike(pair, own) for pair in new(entry) for own in entry["truths"])

    def misnamed(entry: Mapping[str, Any]) -> bool:
        return any(not any(_same(pair, own) for own in entry["truths"]) for pair in new(entry))

    def counted(key: str) -> dict[str, list[int]]:
        groups = {
            name: [entry for entry in sealed if entry[key] == name] for name in dict.fromkeys(o[key] for o in sealed)
        }
        return {name: [sum(matches(entry, _same) for entry in own), len(own)] for name, own in groups.items()}

    def share(flags: Sequence[bool]) -> float | None:
        return sum(flags) / len(flags) if flags else None

    return {
        "sealed": len(sealed),
        "found exactly": share([matches(entry, _same) for entry in sealed]),
        "family and place": share([matches(entry, _alike) for entry in sealed]),
        "misnamed": share([misnamed(entry) for entry in sealed]),
        "failed": sum(entry["verdict"] == "failed" for entry in results),
        "nulls": len(nulls),
        "nulls that name": share([bool(entry["named"]) for entry in nulls if entry["verdict"] != "failed"]),
        "intervals that hold": share(covered),
        "intervals": len(covered),
        "by kind": counted("kind"),
        "by machine": counted("set"),
    }


def line(result: Mapping[str, Any]) -> str:
    """A slot as one line."""
    truth, strength = result.get("truth", {"effect": "", "at": ""}), result.get("strength")
    told = ", ".join(f"{effect}@{at}" for effect, at in result["named"]) or result["verdict"]
    size = (
        f"; {strength['name']} {strength['told']:.4g} ± {strength['std'] or 0.0:.2g} of {strength['true']:.4g}"
        if strength
        else ""
    )
    concealed = f"{truth['effect']}@{truth['at']}" if truth["effect"] else "nothing"
    found = "found" if result["found"] else "near" if result["family"] else "MISSED"
    return f"{found:6}  {result['set']} ({result['kind']}): {concealed} -> {told}{size}"


def _run(name: str, set_name: str, kind: str, draw: Draw | None, work: Work) -> None:
    if kind == "null":
        attempt_null(name, set_name, work)
    else:
        attempt(name, set_name, kind, draw, work)


def _prepare_known(set_name: str, work: Work) -> str:
    """Keeps the machine as it is known; the sentence is why there is none."""
    folder = work.out / "known" / set_name
    if folder.is_dir():
        return ""
    machine, failure = known_machine(raw_machine(work.data, set_name), work)
    if machine is not None:
        folder.parent.mkdir(parents=True, exist_ok=True)
        keep_machine(machine, folder)
    return failure


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.ablate", description=__doc__)
    parser.add_argument("--data", type=Path, default=os.environ.get("DRAKE_CAFIM_DATA"), help="folder of the sets")
    parser.add_argument("--out", type=Path, default=Path("cafim-out/ablations"))
    parser.add_argument("--only", type=int, nargs="*", help="these slots only, with the controls of their machines")
    parser.add_argument("--machines", nargs="*", default=list(SETS), help="these machines only")
    parser.add_argument("--nulls", type=int, default=NULLS_PER_MACHINE, help="real nulls of each machine")
    parser.add_argument("--limit", type=float, default=1800.0, help="s that one diagnosis may take")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="keep the finished slots in --out")
    cafim = str(Path(sys.executable).parent / "cafim")
    parser.add_argument("--diagnose", nargs="+", default=[cafim, "diagnose", "--no-replay"])
    options = parser.parse_args(arguments)
    if options.data is None:
        raise SystemExit("--data or DRAKE_CAFIM_DATA must name the folder of the recorded sets")
    if options.out.exists() and any(options.out.iterdir()) and not options.resume:
        raise SystemExit(f"--out {options.out} is not empty; give --resume, or another folder")
    data = options.data / "data" if (options.data / "data").is_dir() else options.data
    options.out.mkdir(parents=True, exist_ok=True)
    work = Work(data, options.out, options.diagnose, options.limit)
    every = slots()
    wanted = range(len(every)) if options.only is None else options.only
    tasks = [(f"{index:03d}", *every[index]) for index in wanted if every[index][0] in options.machines]
    sets = list(dict.fromkeys(task[1] for task in tasks))
    tasks += [(f"control-{name}", name, "control", None) for name in sets]
    if options.only is None:
        tasks += [(f"null-{name}-{k}", name, "null", None) for name in sets for k in range(options.nulls)]
    parallel = Parallel(n_jobs=options.jobs, return_as="generator_unordered")
    prepared = parallel(delayed(_prepare_known)(name, work) for name in sets)
    failures = [why for why in tqdm(prepared, total=len(sets), desc="machines as they are", file=sys.stderr) if why]
    if failures:
        print("\n".join(f"a machine as it is could not be diagnosed: {why}" for why in failures), file=sys.stderr)
    left = [
        task
        for task in tasks
        if not work.slot(task[0]).is_file() and (task[2] == "null" or (work.out / "known" / task[1]).is_dir())
    ]
    done = parallel(delayed(_run)(*task, work) for task in left)
    for _ in tqdm(done, total=len(left), desc="ablations", file=sys.stderr):
        pass
    results = [json.loads(work.slot(task[0]).read_text()) for task in tasks if work.slot(task[0]).is_file()]
    _write_json(options.out / "ablations.json", results)
    _write_json(options.out / "summary.json", summary(results))
    print("\n".join(map(line, results)))
    print(json.dumps(summary(results), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
