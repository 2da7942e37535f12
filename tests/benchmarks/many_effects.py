"""`python -m tests.benchmarks.many_effects [--short]`: what a diagnosis takes of an arm that lacks much at once.

A random arm of seven joints lacks twenty effects, all its inertials are wrong, and forces that nobody knows act at its
joints; MuJoCo's inertias and a fine integrator make three recordings of 20 s at 500 Hz and one held out. Printed are
wall and processor time and the peak memory of `cafim diagnose`, and how many of the clear effects it names. A row that
`--out` has is kept; the short form is of three joints that lack eight effects, and of recordings of 6 s.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.benchmarks.hour import memory_of
from tests.concealed import arm_case, draw_many, make
from tests.concealed.case import Case
from tests.concealed.score_many import score_many
from tests.concealed.strength_many import reckoned_many
from tests.concealed.trial import write_whole

RATE = 500.0
"""Hz of the recordings."""


@dataclass(frozen=True)
class Size:
    """Effects and joints of an arm, seconds of each recording, and how many minutes of a core a row takes, a guess."""

    effects: int
    joints: int
    seconds: float
    minutes: float


FULL, SHORT = Size(20, 7, 20.0, 60.0), Size(8, 3, 6.0, 4.0)


def arm_that_lacks(size: Size, seed: int) -> Case:
    """A case of the proof's kind "many", of as many effects and as long; the first drawn that stays calm."""
    drawn = arm_case.random_settings

    def longer(rng: np.random.Generator, kind: str) -> arm_case.Settings:
        settings = replace(drawn(rng, kind), step=1.0 / RATE, samples=int(size.seconds * RATE), skip=0)
        return replace(settings, noise="white", jitter="none", has_velocity=True)

    arm_case.random_settings, draw_many.FEWEST, draw_many.MOST = longer, size.effects, size.effects
    for attempt in range(make._ATTEMPTS):
        case = make.simulate("many", f"arm{size.joints}", seed, attempt)
        if make.calm(case):
            return replace(case, truth=case.truth | reckoned_many(case), study={})
    raise RuntimeError(f"seed {seed}: all worlds ran away from their controllers")


def row(case: Case, seed: int, jobs: int) -> str:
    """The table's row of a case, diagnosed by the command."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        case.write(folder)
        trained, held = (sorted(folder.glob(f"{kind}_*.parquet")) for kind in ("train", "held"))
        files = [folder / "scenario.yaml", "--recording", *trained, "--held-out", *held, "--out", folder / "out"]
        command = [sys.executable, "-c", "from drake_cafim.cli import run_cli; run_cli()", "diagnose"]
        before, began, peak = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic(), 0.0
        with subprocess.Popen(
            [*command, *map(str, files), "--no-replay", "--jobs", f"{jobs}"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            while process.poll() is None:
                time.sleep(1.0)
                peak = max(peak, memory_of(process.pid))
        wall, used = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        file = folder / "out" / "report.json"
        report = json.loads(file.read_text()) if process.returncode == 0 else None
        scored = score_many(case.truth, report)
    clear = [there for there, sure in zip(scored["found"], scored["clear_effects"], strict=True) if sure]
    verdict = "failed" if report is None else report["verdict"]
    return (
        f"{seed:>6}{len(scored['found']):>9}{wall:>8.0f}{spent:>13.0f}{peak:>8.2f}  "
        f"{sum(clear)} of {len(clear)} clear ones, {len(scored['wrong_names'])} false  {verdict}"
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.many_effects", description=__doc__)
    parser.add_argument("--short", action="store_true", help="small arms and short recordings: ten minutes")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/many_effects"))
    options = parser.parse_args(arguments)
    size, files = SHORT if options.short else FULL, {}
    for seed in options.seeds:
        files[seed] = options.out / f"{size.joints}_joints_{size.effects}_effects_seed_{seed}.json"
    new = [seed for seed in options.seeds if not files[seed].exists()]
    minutes = size.minutes * len(new)
    print(f"{len(new)} rows, an estimated {minutes:.0f} minutes of one core; the others are in {options.out}")
    print(f"{'seed':>6}{'effects':>9}{'wall s':>8}{'processor s':>13}{'GiB':>8}  named", flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    for seed, file in files.items():
        if seed in new:
            write_whole(file, {"row": row(arm_that_lacks(size, seed), seed, options.jobs)})
        print(json.loads(file.read_text())["row"], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
