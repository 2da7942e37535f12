"""One sealed trial: make a case, seal its truth, run the diagnosis on it in a process of its own, open, score."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .alike import covered_by, matches
from .assumed import assumed
from .case import RECORDINGS
from .fork_server import run_cafim
from .make import make
from .score import score
from .seal import Seal


@dataclass(frozen=True)
class Trial:
    """A slot of the proof; `seed` is the case's own."""

    slot: int
    kind: str
    rig: str
    seed: int


def command(diagnose: list[str], out: str, recordings: Sequence[str] = RECORDINGS) -> list[str]:
    """The diagnosis as a user would start it, in the case's folder; what is held out says so by its name."""
    held = [name for name in recordings if name.startswith("held")]
    train = [name for name in recordings if name not in held]
    left_out = ["--held-out", *held] if held else []
    return [*diagnose, "scenario.yaml", "--recording", *train, *left_out, "--out", out, "--jobs", "1"]


def scrubbed(home: Path) -> dict[str, str]:
    """An environment that tells the child nothing of its parent."""
    return {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), "/usr/bin", "/bin"]),
        "HOME": str(home),
        "TMPDIR": str(home),
        "LANG": "C.UTF-8",
        "OMP_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
    }


def diagnosed(
    diagnose: list[str], folder: Path, home: Path, limit: float, recordings: Sequence[str] = RECORDINGS
) -> tuple[dict[str, Any] | None, str]:
    """The child's report, or why there is none. The report lies where the contract says, whatever the verdict."""
    out, errors = home / "report", home / "stderr.txt"
    line = command(diagnose, str(out), recordings)
    if Path(line[0]).name == "cafim":
        code = run_cafim(line[1:], folder, scrubbed(home), errors, limit)
    else:
        code = _run(line, folder, scrubbed(home), errors, limit)
    if code is None:
        return None, f"no report after {limit:.0f} s"
    if code != 0:
        return None, f"exit {code}: {errors.read_text().strip()[-600:]}"
    try:
        return json.loads((out / "report.json").read_text()), ""
    except (OSError, ValueError) as error:
        return None, f"no readable report.json: {error}"


def _run(line: list[str], folder: Path, environment: dict[str, str], errors: Path, limit: float) -> int | None:
    """The exit code of another's diagnosis, None after `limit` s."""
    with open(errors, "w") as stream:
        try:
            return subprocess.run(
                line, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=stream, timeout=limit, check=False
            ).returncode
        except subprocess.TimeoutExpired:
            return None


def attempt(trial: Trial, diagnose: list[str], out: Path, limit: float, keep: bool) -> dict[str, Any]:
    """The scored trial. The truth leaves this process's memory only after the diagnosis has ended."""
    started = time.perf_counter()
    case = make(trial.kind, trial.rig, trial.seed)
    seal = Seal.close(case.truth)
    name = secrets.token_hex(6)
    made = time.perf_counter()
    with open(out / "seals.txt", "a") as stream:
        stream.write(f"{name} {seal.digest}\n")
    print(f"sealed {name} {seal.digest}", flush=True)
    home = Path(tempfile.mkdtemp(prefix="case-"))
    try:
        folder = home / name
        case.write(folder)
        report, failure = diagnosed(diagnose, folder, home, limit)
        ended = time.perf_counter()
        if keep:
            keep_whole(home, out / "kept" / name)
        verify_sealed(out, name, seal)
        result = scored(folder, seal.truth, report, failure)
    finally:
        shutil.rmtree(home, ignore_errors=True)
    result |= {
        "slot": trial.slot,
        "name": name,
        "case_kind": trial.kind,
        "case_rig": trial.rig,
        "seed": hex(trial.seed),
    }
    result |= {"digest": seal.digest, "salt": seal.salt, "opened": seal.truth, "report": short_report(report)}
    result |= {"made_seconds": made - started, "diagnosed_seconds": ended - made}
    write_whole(out / "opened" / f"{trial.slot:05d}.json", result)
    return result


def scored(folder: Path, truth: Mapping[str, Any], report: dict[str, Any] | None, failure: str) -> dict[str, Any]:
    """The score, with what is known of the strengths of effects that were not named."""
    result = score(truth, report, failure)
    return result | {"covered_unnamed": covered_unnamed(folder, truth, result["named"])}


def sealed_digests(out: Path) -> dict[str, str]:
    """The digests that were told before the diagnoses, by the cases' names."""
    return dict(line.split() for line in (out / "seals.txt").read_text().splitlines())


def verify_sealed(out: Path, name: str, seal: Seal) -> None:
    """Raises where the truth is no longer what the digest of this name was told of."""
    if not seal.verify(sealed_digests(out)[name]):
        raise RuntimeError(f"case {name}: the truth is not the one that was sealed")


def keep_whole(source: Path, target: Path) -> None:
    """A copy of a folder, there with all its files or not at all."""
    temporary = target.with_name(f".{target.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    shutil.copytree(source, temporary)
    shutil.rmtree(target, ignore_errors=True)
    temporary.replace(target)


def write_whole(path: Path, content: Mapping[str, Any]) -> None:
    """JSON, there with all its lines or not at all."""
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps(content, default=float))
    temporary.replace(path)


def covered_unnamed(folder: Path, truth: Mapping[str, Any], named: Sequence[Sequence[str]]) -> list[list[Any]]:
    """As a score's `covered`, of effects that were not named, all that is there being told to a fit."""
    effects = truth["effects"]
    missed = [k for k, effect in enumerate(effects) if not any(matches(reported, effect) for reported in named)]
    if str(truth["kind"]).partition(":")[0] not in ("single", "pair") or not missed:
        return []
    train = [name for name in RECORDINGS if name.startswith("train")]
    try:
        found = assumed(folder, train, effects)
    except (ArithmeticError, np.linalg.LinAlgError):
        # a fit that fails holds no truth, and hours of other cases go on
        return [[name, False, np.nan] for k in missed for name in effects[k]["parameters"]]
    return [entry for k in missed if found for entry in covered_by(effects[k], found[k])]


def short_report(report: dict[str, Any] | None) -> dict[str, Any] | None:
    """The report's findings, without its long parts."""
    if report is None:
        return None
    kept = ("verdict", "mismatch", "explanation", "rivals", "data_mistakes", "noise_remarks", "parameters")
    return {key: report.get(key) for key in kept}
