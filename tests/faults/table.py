"""`make faults`: commands are killed, starved of disk, and robbed of their folders; a row a fault.

    make faults                    # 200 kills; FAULTS="--kills 20 --only import diagnose" for fewer
    make faults FAULTS="--kept faults.jsonl"         # goes on with the next trial where it was ended

After every fault files are whole, what the command says is one line, and the command given again ends with the bytes
of an undisturbed run. Every row counts faults, files that were left half, trials whose results were lost, twice or
different, and other words than the one line.
"""

import argparse
import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tests.faults import trials
from tests.faults.commands import SUBJECTS
from tests.faults.trials import Bench, Trial

FAULTS: dict[str, tuple[Callable[[Bench, int, np.random.Generator], Trial], Callable[[Bench, int], int]]] = {
    "kill -9 at a random moment": (trials.kill, lambda bench, kills: kills),
    "kill -9 at a write": (trials.kill_at_write, lambda bench, kills: len(bench.sizes)),
    "Ctrl-C, SIGTERM": (trials.interrupt, lambda bench, kills: max(2, kills // 4)),
    "disk full at a write": (trials.fill_disk, lambda bench, kills: len(bench.sizes)),
    "clock jumps": (trials.jump_clock, lambda bench, kills: 2),
    "two on one --out": (trials.two_on_one_folder, lambda bench, kills: 4),
    "folder lost": (trials.lose_folder, lambda bench, kills: 5),
}
"""By name what is tried, and how often."""


def row(command: str, fault: str, tried: list[Trial]) -> str:
    """A row of the table."""
    half, lost, words = (
        [text for trial in tried for text in getattr(trial, kind)] for kind in ("half", "lost", "words")
    )
    counts = f"{sum(trial.faults for trial in tried)} | {len(half)} | {len(lost)} | {len(words)}"
    return f"| {command} | {fault} | {counts} | {'; '.join([*half, *lost, *words][:2])} |"


def main() -> None:
    """Try the faults, and print the table; the exit status is 1 where something went wrong."""
    parser = argparse.ArgumentParser(description="Faults while commands run, and a table of what became of them.")
    parser.add_argument("--kills", type=int, default=200, help="kills at random moments, over all commands")
    parser.add_argument("--only", nargs="+", choices=list(SUBJECTS), default=list(SUBJECTS), help="which commands")
    parser.add_argument("--faults", nargs="+", choices=list(FAULTS), default=list(FAULTS), help="which faults")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, help="a file of the finished trials")
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    done: dict[tuple[str, str, int], Trial] = {}
    if arguments.kept and arguments.kept.exists():
        for line in arguments.kept.read_text().splitlines():
            command, fault, number, found = json.loads(line)
            done[command, fault, number] = Trial(**found)
    kills = -(-arguments.kills // len(arguments.only))
    failed = False
    print("| command | fault | faults | half files | lost, twice, different | other words | first of them |")
    print("|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as name:
        for subject in (SUBJECTS[name] for name in arguments.only):
            bench = Bench.of(subject, Path(name) / subject.name.replace(" ", "_"))
            for fault in arguments.faults:
                attempt, count = FAULTS[fault]
                tried = []
                for number in range(count(bench, kills)):
                    key = subject.name, fault, number
                    if key not in done:
                        seeds = [arguments.seed, list(SUBJECTS).index(subject.name), list(FAULTS).index(fault), number]
                        done[key] = attempt(bench, number, np.random.default_rng(seeds))
                        if arguments.kept:
                            with arguments.kept.open("a") as file:
                                file.write(json.dumps([*key, asdict(done[key])]) + "\n")
                    tried.append(done[key])
                failed = failed or any(trial.half or trial.lost or trial.words for trial in tried)
                print(row(subject.name, fault, tried), flush=True)
    raise SystemExit(failed)


if __name__ == "__main__":
    main()
