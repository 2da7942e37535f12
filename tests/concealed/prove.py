"""`python -m tests.concealed.prove --size N --out DIR --jobs J [--resume]`: the blind proof.

Each case's truth is sealed by a salted hash that is printed before its diagnosis starts. The seeds come from the
system's entropy when the proof starts, so after the last change to the diagnosis, whose commit is printed and stands on
the page.
A killed run goes on with --resume: finished trials stay, the others are made anew from fresh entropy.

`--again DIR --out DIR2 [--cases NAME ...]` diagnoses the cases that a proof with --keep left in DIR by the present
code, and compares: see `again`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from drake_cafim.parallel.distribute import distribute
from drake_cafim.parallel.task import Task

from .again import run_again
from .page import write_page
from .plan import FULL, composition, counted_as
from .seal import canonical, case_seed, fresh_seed
from .summary import figures
from .trial import Trial, attempt

ROOT = Path(__file__).resolve().parents[2]


def commit() -> str:
    """The commit of the working tree, and whether the package differs from it."""
    head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    paths = ["drake_cafim", "diagrams", "models"]
    changed = subprocess.run(
        ["git", "status", "--porcelain", *paths], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout
    return (head or "no repository") + (" (with uncommitted changes to the diagnosis)" if changed.strip() else "")


def opened(out: Path) -> list[dict[str, Any]]:
    """Trials that have ended."""
    return [json.loads(path.read_text()) for path in sorted((out / "opened").glob("*.json"))]


PAGE_EVERY = 25
"""Trials after which the page is written anew, since hours pass."""


def prepare(out: Path, resume: bool, overwrite: bool) -> None:
    """An empty folder, or one to go on in."""
    if out.exists() and any(out.iterdir()) and not resume:
        if not overwrite:
            raise SystemExit(f"{out} is not empty: --resume goes on in it, --overwrite starts anew")
        for path in (out / "opened").glob("*.json"):
            path.unlink()
        for name in ("seals.txt", "about.json", "scores.json", "proof.html"):
            (out / name).unlink(missing_ok=True)
    (out / "opened").mkdir(parents=True, exist_ok=True)


def about(out: Path, size: int, seed: str | None) -> dict[str, Any]:
    """What the page says of the run; the composition's seed is kept so that a resumed run has the same slots."""
    path = out / "about.json"
    known: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {"starts": []}
    if known["starts"] and known["size"] != size:
        raise SystemExit(f"{out} was begun with --size {known['size']}, not {size}")
    known |= {"size": size, "composition": known.get("composition", fresh_seed() if seed is None else seed)}
    known["starts"].append(
        {"commit": commit(), "time": time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime()), "debug_seed": seed}
    )
    path.write_text(json.dumps(known, indent=1) + "\n")
    return known


def write_results(out: Path, known: dict[str, Any], elapsed: float) -> list[dict[str, Any]]:
    """scores.json and proof.html from the opened trials."""
    scores = opened(out)
    table = [figure.__dict__ for figure in figures(scores)]
    text = json.dumps({"about": known, "figures": table, "trials": scores}, indent=1, default=float)
    (out / "scores.json.part").write_text(text + "\n")
    (out / "scores.json.part").replace(out / "scores.json")
    write_page(out / "proof.html", known, scores, elapsed)
    return scores


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.prove", description=__doc__)
    parser.add_argument("--size", type=int, default=60)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/proof"))
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--scheduler", help="of a Dask cluster whose workers have this checkout and --out at its path")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--keep", action="store_true", help="keep each case's folder and report")
    parser.add_argument("--limit", type=float, default=600.0, help="s that one diagnosis may take")
    parser.add_argument("--seed", help="for debugging only; the page says so")
    parser.add_argument("--only", type=int, nargs="*", help="these slots only")
    parser.add_argument("--kinds", nargs="+", choices=list(FULL), help="cases of these kinds only")
    cafim = str(Path(sys.executable).parent / "cafim")
    parser.add_argument(
        "--again", type=Path, metavar="DIR", help="diagnose the cases that are kept in DIR, and compare"
    )
    parser.add_argument("--cases", nargs="+", help="of --again: these names only")
    parser.add_argument("--diagnose", nargs="+", default=[cafim, "diagnose", "--no-replay"])
    options = parser.parse_args(arguments)
    diagnose = [str(Path(part).absolute()) if Path(part).exists() else part for part in options.diagnose]
    if options.again is not None:
        if options.keep or options.seed or options.only or options.kinds:
            parser.error("--again takes its cases from DIR: --keep, --seed, --only and --kinds are of new ones")
        return run_again(
            options.again,
            options.out,
            commit(),
            diagnose,
            limit=options.limit,
            jobs=options.jobs,
            resume=options.resume,
            overwrite=options.overwrite,
            only=options.cases,
        )
    if options.cases:
        parser.error("--cases are of --again DIR")
    started = time.perf_counter()
    prepare(options.out, options.resume, options.overwrite)
    known = about(options.out, options.size, options.seed)
    # Drawn after the commit was read: nobody can have tuned the diagnosis to it.
    master = options.seed or fresh_seed()
    slots = composition(np.random.default_rng(int(known["composition"], 0)), options.size)
    done = {item["slot"] for item in opened(options.out)}
    kinds = options.kinds or list(FULL)
    asked = [i for i in range(len(slots)) if counted_as(slots[i]) in kinds]
    wanted = [i for i in asked if i not in done and (options.only is None or i in options.only)]
    print(f"diagnosis at commit {known['starts'][-1]['commit']}", flush=True)
    print(
        f"{len(slots)} trials, {len(done)} ended before, {len(wanted)} to run; seeds sealed under {_digest(master)}",
        flush=True,
    )
    trials = [Trial(i, *slots[i], seed=case_seed(master, i)) for i in wanted]
    out = options.out.absolute()
    tasks = [
        Task(f"trial {entry.slot}", attempt, (entry, diagnose, out, options.limit, options.keep)) for entry in trials
    ]
    results = distribute(tasks, options.jobs, options.scheduler)
    for number, result in enumerate(tqdm(results, total=len(trials), desc="trials", file=sys.stderr), 1):
        if result.failure:
            # it has no score, and is run anew by --resume
            print(result.failure, file=sys.stderr, flush=True)
        if number % PAGE_EVERY == 0:
            write_results(options.out, known, time.perf_counter() - started)
    scores = write_results(options.out, known, time.perf_counter() - started)
    for figure in figures(scores):
        value = "–" if figure.value is None else f"{figure.value:.3f}"
        print(f"{value:>7} {figure.limit:>10} {figure.mark:>16}  {figure.name} ({figure.count})")
    print(options.out / "proof.html")
    return 0


def _digest(master: str) -> str:
    return hashlib.sha256(canonical({"seed": master})).hexdigest()[:16]


if __name__ == "__main__":
    sys.exit(main())
