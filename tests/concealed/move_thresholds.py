"""`python -m tests.concealed.move_thresholds DIR --out OUT [--jobs J] [--resume]`: what each threshold changes.

Each threshold that is there for good is moved by a third up and down, in a process of its own, and kept cases of a
proof (`prove --keep --out DIR`) are diagnosed with it. A table tells how many of them end with another verdict or other
names, and how many with other numbers or words alone. It takes hours, which it says beforehand; a killed run goes on
with --resume.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm

from drake_cafim.diagnosis import thresholds

from .again import case_folder, kept_cases, opened_record
from .case import RECORDINGS
from .compare import grade, outcome
from .score import score
from .trial import scrubbed, short_report, write_whole

ROOT = Path(__file__).resolve().parents[2]
FACTORS = {"up": 4.0 / 3.0, "down": 2.0 / 3.0}

REPLACED_LATER = frozenset(
    {
        "AGREEING_VELOCITY_STDS",
        "CANDIDATE_GAIN_SHARE_REFITTED",
        "CHANNEL_SMOOTHING_REACH",
        "COMPETING_CRITERION_REACH",
        "CORRECTION_COST_ALLOWANCE",
        "INITIAL_DOUBT_ROW_CHANGE",
        "MISFIT_REDUCED_CHI_SQUARE",
        "MISFIT_SHARE_TO_EXPLAIN",
        "NAMED_EXCESS_SHARE",
        "POSITION_SMOOTHING_DEGREE",
        "POSITION_SMOOTHING_REACHES",
        "RECORDINGS_SHARE_IMPROVED",
        "REGRESSOR_SIGNAL_SHARE",
        "RESTING_SMOOTHING_REACHES",
        "RESTING_VELOCITY_STDS",
        "RIVALS_FITTED_PER_PARENT",
        "RIVAL_EXCESS_CHI_SQUARE",
        "UNKNOWN_FORCE_VARIANCE_SHARE",
        "UNKNOWN_REACH_IN_PRIOR_STDS",
        "VELOCITY_SMOOTHING_REACH",
        "WIDER_WINDOW_RATIOS",
        "WIDEST_WINDOW",
        "WINDOWS_PER_BLOCK",
        "WINDOW_WIDTH",
    }
)
"""Thresholds of rows and of a search that will be replaced: all the others are moved."""


def movable() -> list[str]:
    """Names of the thresholds that are there for good, in the order of their file."""
    return [name for name in vars(thresholds) if name.isupper() and name not in REPLACED_LATER]


def chosen(source: Path, count: int) -> list[dict[str, Any]]:
    """Opened records of kept cases, of the four kinds in turn and in the order of their slots."""
    records = [record for name in kept_cases(source) if (record := opened_record(source, name)) is not None]
    records.sort(key=lambda record: record["slot"])
    kinds = ("single", "null", "odd", "pair")
    by_kind = [[item for item in records if item["case_kind"].partition(":")[0] == kind] for kind in kinds]
    return [item for lap in zip_longest(*by_kind) for item in lap if item is not None][:count]


@dataclass(frozen=True)
class Task:
    """A case, and the threshold that is moved; both empty: none."""

    case: str
    name: str = ""
    way: str = ""

    @property
    def file(self) -> str:
        return f"{self.case}.{self.name or 'as_it_is'}.{self.way}.json"


def tasks(cases: Sequence[str]) -> Iterator[Task]:
    """All of them: the thresholds as they are, then each of them moved both ways."""
    yield from (Task(case) for case in cases)
    yield from (Task(case, name, way) for name in movable() for way in FACTORS for case in cases)


def command(task: Task, folder: Path, out: Path) -> list[str]:
    """What diagnoses the case with the threshold moved."""
    held = [str(folder / name) for name in RECORDINGS if name.startswith("held")]
    train = [str(folder / name) for name in RECORDINGS if not name.startswith("held")]
    files = [str(folder / "scenario.yaml"), "--recording", *train, "--held-out", *held, "--out", str(out)]
    factor = [task.name, str(FACTORS[task.way])] if task.name else []
    start = [sys.executable, "-m", "tests.concealed.moved_diagnosis", *factor]
    return [*start, "diagnose", *files, "--no-replay", "--jobs", "1"]


def run(task: Task, source: Path, out: Path, limit: float) -> None:
    """Writes OUT/runs/TASK.json: the report's findings, or why there are none."""
    home = Path(tempfile.mkdtemp(prefix="moved-"))
    try:
        line = command(task, case_folder(source, task.case).resolve(), home / "report")
        try:
            ended = subprocess.run(
                line, cwd=ROOT, env=scrubbed(home), capture_output=True, text=True, timeout=limit, check=False
            )
            failure = "" if ended.returncode == 0 else f"exit {ended.returncode}: {ended.stderr.strip()[-300:]}"
        except subprocess.TimeoutExpired:
            failure = f"no report after {limit:.0f} s"
        report = None if failure else json.loads((home / "report" / "report.json").read_text())
    finally:
        shutil.rmtree(home, ignore_errors=True)
    write_whole(out / "runs" / task.file, {"report": report, "failure": failure})


@dataclass(frozen=True)
class Effect:
    """What a threshold changed over the cases: other outcomes with what they were, and other numbers alone."""

    name: str
    way: str
    outcomes: tuple[str, ...]
    numbers: int
    cases: int

    def text(self) -> str:
        value = getattr(thresholds, self.name)
        first = f"{self.name} = {value}, {self.way}: {len(self.outcomes)} of {self.cases} with another outcome, "
        return "\n".join(
            [first + f"{self.numbers} with other numbers or words", *(f"    {line}" for line in self.outcomes)]
        )


def effects(records: Sequence[dict[str, Any]], out: Path) -> list[Effect]:
    """What is known so far; thresholds with cases that have not run are left out."""
    found = []
    for name in movable():
        for way in FACTORS:
            there = [(out / "runs" / Task(item["name"], name, way).file).exists() for item in records]
            if all(there):
                found.append(_effect(records, out, name, way))
    return found


def _effect(records: Sequence[dict[str, Any]], out: Path, name: str, way: str) -> Effect:
    outcomes, numbers = [], 0
    for record in records:
        before, after = (
            json.loads((out / "runs" / task.file).read_text())
            for task in (Task(record["name"]), Task(record["name"], name, way))
        )
        old, new = (score(record["opened"], run["report"], run["failure"]) for run in (before, after))
        if outcome(old) != outcome(new):
            rise = grade(new) - grade(old)
            kind = "better" if rise > 0 else "worse" if rise < 0 else "other"
            outcomes.append(f"{kind}: {record['case_kind']} on {record['case_rig']}: {_told(old)} → {_told(new)}")
        elif short_report(before["report"]) != short_report(after["report"]):
            numbers += 1
    return Effect(name, way, tuple(outcomes), numbers, len(records))


def _told(item: dict[str, Any]) -> str:
    return " ".join([item["verdict"], *(f"{name}@{at}" for name, at in item["named"])])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.move_thresholds", description=__doc__)
    parser.add_argument("source", type=Path, metavar="DIR", help="the folder of a proof that was run with --keep")
    parser.add_argument("--out", type=Path, default=Path("cafim-out/thresholds"))
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=600.0, help="s that one diagnosis may take")
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args(arguments)
    runs = options.out / "runs"
    if runs.exists() and any(runs.iterdir()) and not options.resume:
        raise SystemExit(f"{options.out} is not empty: --resume goes on in it")
    runs.mkdir(parents=True, exist_ok=True)
    records = chosen(options.source, options.cases)
    if not records:
        raise SystemExit(f"{options.source} holds no kept case that was opened")
    wanted = [task for task in tasks([item["name"] for item in records]) if not (runs / task.file).exists()]
    seconds = {item["name"]: item["diagnosed_seconds"] for item in records}
    hours = sum(seconds[task.case] for task in wanted) / 3600.0 / max(options.jobs, 1)
    print(
        f"{len(movable())} thresholds, {len(records)} cases, {len(wanted)} diagnoses: about {hours:.1f} hours",
        flush=True,
    )
    work = (delayed(run)(task, options.source, options.out, options.limit) for task in wanted)
    results = Parallel(n_jobs=options.jobs, return_as="generator_unordered", batch_size=1)(work)
    for _ in tqdm(results, total=len(wanted), desc="diagnoses", file=sys.stderr):
        pass
    text = "\n".join(effect.text() for effect in effects(records, options.out))
    (options.out / "thresholds.txt").write_text(text + "\n")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
