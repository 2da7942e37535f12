"""Diagnoses the kept cases of a proof with the present code, and compares the scores with those of the proof.

OUT/kept/NAME holds the new report, OUT/opened the new scores, OUT/scores.json both figures, and OUT/comparison.html
what has changed. A case's truth is opened after its new verdict is written; its seal is checked then.
The cases were opened once before, so that what comes out is a comparison and no blind proof.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm

from .case import RECORDINGS
from .compare import changes, comparison, write_comparison
from .score import score
from .seal import Seal
from .trial import diagnosed, keep_whole, scored, sealed_digests, short_report, verify_sealed, write_whole

VERDICT = "verdict.json"
"""What a diagnosis ended with, beside its report: written before the truth is opened."""


def kept_cases(source: Path) -> list[str]:
    """Names of the sealed cases whose folders are whole."""
    wanted = ("scenario.yaml", *RECORDINGS)
    if not (source / "seals.txt").exists():
        raise SystemExit(f"{source}: no seals.txt; --again needs the folder of a proof that was run with --keep")
    names = sorted(sealed_digests(source))
    return [name for name in names if all((case_folder(source, name) / file).exists() for file in wanted)]


def case_folder(source: Path, name: str) -> Path:
    """Where a proof has kept what the diagnosis was given."""
    return source / "kept" / name / name


def kept_report(folder: Path) -> dict[str, Any] | None:
    """The report in a kept case's folder, None where the diagnosis left none."""
    path = folder / "report" / "report.json"
    return json.loads(path.read_text()) if path.exists() else None


def diagnose_again(source: Path, name: str, out: Path, diagnose: list[str], limit: float) -> None:
    """Leaves the new report and verdict under OUT/kept/NAME; knows nothing of the truth."""
    started = time.perf_counter()
    home = Path(tempfile.mkdtemp(prefix="case-"))
    try:
        shutil.copytree(case_folder(source, name), home / name)
        report, failure = diagnosed(diagnose, home / name, home, limit)
        shutil.rmtree(home / name)
        ended = {"failure": failure, "diagnosed_seconds": time.perf_counter() - started}
        write_whole(home / VERDICT, ended | {"verdict": None if report is None else report["verdict"]})
        keep_whole(home, out / "kept" / name)
    finally:
        shutil.rmtree(home, ignore_errors=True)


def opened_record(source: Path, name: str) -> dict[str, Any] | None:
    """The proof's opened trial of this name, its truth as it was sealed; None while the proof has not opened it."""
    for path in sorted((source / "opened").glob("*.json")):
        record: dict[str, Any] = json.loads(path.read_text())
        if record["name"] == name:
            verify_sealed(source, name, Seal(record["opened"], record["salt"]))
            return record
    return None


IDENTITY = ("slot", "name", "case_kind", "case_rig", "seed", "digest", "salt", "opened")


def scored_before(source: Path, record: dict[str, Any]) -> dict[str, Any]:
    """What was told before, scored as now; intervals of effects that were not named stay those of that code."""
    report = kept_report(source / "kept" / record["name"])
    kept = {key: record[key] for key in (*IDENTITY, "covered_unnamed", "diagnosed_seconds")}
    return kept | score(record["opened"], report, record["failure"])


def scored_again(source: Path, out: Path, record: dict[str, Any]) -> dict[str, Any]:
    """What is told now, scored."""
    name = record["name"]
    ended = json.loads((out / "kept" / name / VERDICT).read_text())
    report = kept_report(out / "kept" / name) if ended["verdict"] is not None else None
    kept = {key: record[key] for key in IDENTITY} | {"diagnosed_seconds": ended["diagnosed_seconds"]}
    return (
        kept
        | {"report": short_report(report)}
        | scored(case_folder(source, name), record["opened"], report, ended["failure"])
    )


def attempt_again(source: Path, name: str, out: Path, diagnose: list[str], limit: float) -> bool:
    """Whether the case could be scored: diagnosed if it was not yet, and only then opened."""
    if not (out / "kept" / name / VERDICT).exists():
        diagnose_again(source, name, out, diagnose, limit)
    record = opened_record(source, name)
    if record is None:
        return False
    write_whole(out / "opened" / f"{record['slot']:05d}.json", scored_again(source, out, record))
    return True


def prepare(source: Path, out: Path, resume: bool, overwrite: bool) -> None:
    """An empty folder, or one to go on in; never the proof's own."""
    if out.resolve() == source.resolve():
        raise SystemExit(f"{out} holds the kept cases: --out must name another folder")
    if out.exists() and any(out.iterdir()) and not resume:
        if not overwrite:
            raise SystemExit(f"{out} is not empty: --resume goes on in it, --overwrite starts anew")
        for folder in ("kept", "opened"):
            shutil.rmtree(out / folder, ignore_errors=True)
        for name in ("about.json", "scores.json", "comparison.html"):
            (out / name).unlink(missing_ok=True)
    for folder in ("kept", "opened"):
        (out / folder).mkdir(parents=True, exist_ok=True)


def write_about(source: Path, out: Path, commit: str) -> dict[str, Any]:
    """Commits and times of the proof and of this comparison, which adds one at each start."""
    path = out / "about.json"
    about: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {"starts": []}
    proof = source / "about.json"
    about["before"] = json.loads(proof.read_text())["starts"] if proof.exists() else []
    about["starts"].append({"commit": commit, "time": time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())})
    path.write_text(json.dumps(about, indent=1) + "\n")
    return about


def write_results(source: Path, out: Path, about: dict[str, Any]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """scores.json and comparison.html; returns the scores before and after, case by case."""
    after = [json.loads(path.read_text()) for path in sorted((out / "opened").glob("*.json"))]
    records = {record["name"]: record for record in map(json.loads, _opened_texts(source))}
    before = [scored_before(source, records[item["name"]]) for item in after]
    table = comparison(before, after)
    text = {"about": about, "figures": [line.__dict__ for line in table], "before": before, "after": after}
    write_whole(out / "scores.json", text)
    write_comparison(out / "comparison.html", about, table, changes(before, after), len(after))
    return before, after


def _opened_texts(source: Path) -> list[str]:
    return [path.read_text() for path in sorted((source / "opened").glob("*.json"))]


PAGE_EVERY = 10
"""Cases after which the comparison is written anew, since hours pass."""


def run_again(
    source: Path,
    out: Path,
    commit: str,
    diagnose: list[str],
    *,
    limit: float,
    jobs: int = 1,
    resume: bool = False,
    overwrite: bool = False,
    only: Sequence[str] | None = None,
) -> int:
    """Diagnoses and compares; returns the exit status."""
    names = kept_cases(source)
    if unknown := sorted(set(only or ()) - set(names)):
        raise SystemExit(f"{source}/kept holds no whole case {', '.join(unknown)}")
    names = [name for name in names if only is None or name in only]
    prepare(source, out, resume, overwrite)
    about = write_about(source, out, commit)
    done = {json.loads(path.read_text())["name"] for path in (out / "opened").glob("*.json")}
    wanted = [name for name in names if name not in done]
    print(f"diagnosis at commit {commit}: {len(names)} kept cases, {len(wanted)} to run", flush=True)
    work = (delayed(attempt_again)(source, name, out, diagnose, limit) for name in wanted)
    results = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)(work)
    closed = 0
    for number, scored_now in enumerate(tqdm(results, total=len(wanted), desc="cases", file=sys.stderr), 1):
        closed += not scored_now
        if number % PAGE_EVERY == 0:
            write_results(source, out, about)
    before, after = write_results(source, out, about)
    for line in comparison(before, after):
        print(line.text())
    for change in changes(before, after):
        print(change.text())
    if closed:
        print(f"{closed} cases have no opened truth yet; --resume scores them once the proof has opened them")
    print(out / "comparison.html")
    return 0
