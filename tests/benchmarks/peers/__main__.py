"""Prints `cafim estimate` and `mujoco.sysid` side by side, on the same recordings, beside the Cramér–Rao bound.

    python -m tests.benchmarks.peers [--seeds N] [--out cafim-out/bench] [--tools ours mujoco.sysid ...] [TASK ...]

For each seed each tool answers in turn, in a process of its own with one thread. `s` is the median time of a call, and
what it is of mujoco.sysid's on the same seeds; `converged` counts answers with every parameter within ten standard
deviations of the bound or ten per cent of the truth, whichever is more. Of answers that converged, `error` is the
smallest and the largest over parameters of the median error, then the largest of all; `of bound` the root mean square
error over the bound's, its median over parameters; `coverage` how often 95 % intervals hold the truth, with a 99 %
interval that resamples seeds. `MiB` is the process' peak. "sysid, weights" is mujoco.sysid with weights that make its
residual the likelihood's. Robots are integrated by MuJoCo's Runge-Kutta method at 1 kHz, and so are mujoco.sysid's.

What was finished stands in the folder and is not done again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from drake_cafim.cli import progress_line
from tests.concealed.robots import Array

from .task import Task, bound
from .tasks import TASKS
from .tools import TOOLS, Answer, single

OURS, THEIRS = "ours", "mujoco.sysid"
HEADER = (
    f"{'task':12}{'tool':16}{'converged':>12}{'s':>8}{'of sysid':>10}{'error %, median':>20}{'largest':>9}"
    f"{'of bound':>10}{'coverage [99 %]':>24}{'MiB':>7}"
)


def answers(task: Task, tools: Sequence[str], seeds: int, out: Path) -> tuple[Array, dict[str, list[Answer]]]:
    """The bounds (seeds, p) and each tool's answers, by seed."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{task.name}.jsonl"
    lines = [line for line in path.read_text().splitlines() if line.endswith("}")] if path.is_file() else []
    done = {(entry["what"], entry["seed"]): entry["found"] for entry in map(json.loads, lines)}
    context = get_context("spawn")
    pools = {tool: ProcessPoolExecutor(1, mp_context=context) for tool in tools}
    with path.open("a") as file, progress_line() as progress:

        def told(what: str, seed: int, found: object) -> None:
            done[what, seed] = json.loads(json.dumps(found))
            file.write(json.dumps({"what": what, "seed": seed, "found": found}) + "\n")
            file.flush()

        for seed in range(seeds):
            progress(f"{task.name}: seed {seed + 1} of {seeds}")
            if ("bound", seed) not in done:
                told("bound", seed, bound(task, seed).tolist())
            for tool in tools:
                if (tool, seed) not in done:
                    told(tool, seed, asdict(pools[tool].submit(single, tool, TASKS.index(task), seed).result()))
    for pool in pools.values():
        pool.shutdown()
    found = {tool: [Answer(**done[tool, seed]) for seed in range(seeds)] for tool in tools}
    return np.array([done["bound", seed] for seed in range(seeds)]), found


def line(task: Task, tool: str, bounds: Array, found: Sequence[Answer], others: Sequence[Answer] | None) -> str:
    """The table's line of a tool."""
    there = [k for k, item in enumerate(found) if item.values is not None]
    values = np.array([found[k].values for k in there], dtype=float).reshape(len(there), -1)
    std = np.array([found[k].std for k in there], dtype=float).reshape(len(there), -1)
    off = np.abs(values - task.true) if there else np.zeros((0, len(task.true)))
    near = np.all(off <= np.maximum(10.0 * bounds[there], 0.1 * task.true), axis=1)
    off, std, limits = off[near], std[near], bounds[there][near]
    seconds = float(np.median([item.seconds for item in found]))
    share = seconds / float(np.median([item.seconds for item in others])) if others else float("nan")
    memory = max(item.megabytes for item in found)
    start = f"{task.name:12}{tool:16}{f'{len(off)} of {len(found)}':>12}{seconds:8.2f}{share:10.2f}"
    if not len(off):
        return f"{start}{'':>63}{memory:7.0f}"
    percent = 100.0 * off / task.true
    middle = np.median(percent, axis=0)
    held = np.mean(off < 1.96 * std, axis=1)
    again = np.random.default_rng(0).integers(0, len(held), (4000, len(held)))
    low, high = np.quantile(np.mean(held[again], axis=1), (0.005, 0.995))
    ratio = float(np.median(np.sqrt(np.mean(off**2, axis=0)) / np.sqrt(np.mean(limits**2, axis=0))))
    errors, coverage = f"{min(middle):.2g} to {max(middle):.2g}", f"{np.mean(held):.3f} [{low:.2f}, {high:.2f}]"
    return f"{start}{errors:>20}{np.max(percent):9.2g}{ratio:10.2g}{coverage:>24}{memory:7.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", help="All, or some of: " + ", ".join(task.name for task in TASKS))
    parser.add_argument("--seeds", type=int, help="The task's own number by default.")
    parser.add_argument("--tools", nargs="+", default=list(TOOLS), choices=list(TOOLS))
    parser.add_argument("--out", type=Path, default=Path("cafim-out/bench"))
    arguments = parser.parse_args()
    wrong = set(arguments.tasks) - {task.name for task in TASKS}
    if wrong:
        parser.error(f"no such task: {', '.join(sorted(wrong))}; there are {', '.join(task.name for task in TASKS)}")
    print(HEADER, flush=True)
    for task in [task for task in TASKS if not arguments.tasks or task.name in arguments.tasks]:
        bounds, found = answers(task, arguments.tools, arguments.seeds or task.seeds, arguments.out)
        for tool, own in found.items():
            print(line(task, tool, bounds, own, found.get(THEIRS)), flush=True)


if __name__ == "__main__":
    main()
