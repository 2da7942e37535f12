"""How soon motions tell confusable explanations apart: designed, D-optimal and random ones, with noise.

    python -m tests.benchmarks.discrimination [--seeds 20] [--out cafim-out/discrimination] [GROUP ...]

prints the table. For each explanation of a group, were it true, each motion is simulated in closed loop, again and
again, and recorded with noise; the robot time after which the odds for the truth against each of its rivals are over
20 : 1 is counted. A group's time for a seed is that of the explanation that takes longest.

All motions are cycles of 2 s, from rest to rest, run again and again. The D-optimal one has the designed one's planner,
its budget and its first draws. Random ones are drawn as the package's random policy draws them, velocities through
random knots up to the joints' limits: six, and each seed repeats one of them. The last column is of runs that take
another of the six each time instead. The controller reads the joints without noise, so that a motion's seeds share one
simulation; noise is on all that is recorded. Odds along a run are those of its noisy data, each explanation refitted to
first order about its best numbers for the data without noise.

What was finished stands in the folder and is not done again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.cli import progress_line
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.discrimination.closed_loop import measured, simulated
from drake_cafim.discrimination.design import Designer, Progress
from drake_cafim.discrimination.evidence import Course, Explained, explain, looked
from drake_cafim.discrimination.motions import Motion
from drake_cafim.discrimination.scores import TWENTY_TO_ONE, Information, Soonest, Value
from drake_cafim.output import write_text

from .confusable import GROUPS, Group, models, pairs, random_motion

CYCLES = 64
"""Motions of a run after which it is given up."""
RANDOM_POOL = 6
"""Different random motions."""
SOON = 3.5
"""ln odds that the designed motion is to be expected to reach soonest.

Along a run ln odds drift as a normal walk whose variance is twice its mean. Where 3.5 are expected, seven runs in ten
have passed ln 20, and of two explanations both have in every other: the median that is measured.
"""
POLICIES = ("designed", "D-optimal", "random", "ever new")
OF_RANDOM, OF_D_OPTIMAL = 1 / 3, 2 / 3
COLUMNS = ("designed, s", "D-optimal, s", "random, s", "of random", "of D-optimal", "", "of ever new")
HEADER = f"{'':30}" + "".join(f"{name:>14}" for name in COLUMNS)


@dataclass(frozen=True)
class Cycle:
    """One motion as it goes where `truth` holds: its clean run, and every explanation about its own best numbers."""

    run: Motion
    clean: Problem
    explained: tuple[Explained, ...]  # the truth first


def cycle(designer: Designer, truth: Model, rivals: Sequence[Model], planned: Motion) -> Cycle:
    scene, std = designer.scene, designer.bench.samples.std
    physics = truth.physics(scene)
    run = simulated(physics, scene.physics, designer.limits, planned)
    quiet = measured(scene, physics, run, dict.fromkeys(std, 0.0), np.random.default_rng(0), "clean")
    clean = designer.bench.reading(quiet)
    return Cycle(run, clean, (looked(clean, truth), *(explain(clean, rival) for rival in rivals)))


def settled(designer: Designer, cycles: Sequence[Cycle], random: np.random.Generator) -> float:
    """The robot time s after which the odds for the truth are over 20 : 1 against each rival."""
    scene = designer.scene
    truth = cycles[0].explained[0].model
    physics, std = truth.physics(scene), designer.bench.samples.std
    windows = cycles[0].clean.runs[0].weak.samples.windows
    ends, duration = windows.starts + windows.width - windows.time[0], designer.shape.duration
    so_far: list[Course] | None = None
    for number in range(CYCLES):
        one = cycles[number % len(cycles)]
        recording = measured(scene, physics, one.run, std, random, "run")
        problem = designer.bench.reading(recording, one.clean)
        courses = []
        for explained in one.explained:
            rows = problem.residual(explained.model)[: problem.rows]
            courses.append(Course.of(problem, explained, rows))
        if so_far is not None:
            courses = [course.after(before) for course, before in zip(courses, so_far, strict=True)]
        so_far = courses
        evidence = np.stack([course.log_evidence for course in courses])
        over = np.flatnonzero(np.min(evidence[0] - evidence[1:], axis=0) >= TWENTY_TO_ONE)
        if len(over):
            return float(number * duration + ends[over[0]])
    return float("inf")


def measure(group: Group, seeds: int, out: Path, progress: Progress) -> dict[str, object]:
    """Settling times by policy: one list of seeds for each explanation."""
    designer = Designer.of(group.scene(out / "machines" / group.slug))
    progress(f"{group.name}: sizes")
    found = models(group, designer, np.random.default_rng(0))
    random = np.random.default_rng(1)
    planned: Mapping[str, Sequence[Motion]] = {
        "designed": [_designed(designer, Soonest(pairs(found), SOON), out / f"{group.slug}_designed.json", progress)],
        "D-optimal": [_designed(designer, Information(found), out / f"{group.slug}_D-optimal.json", progress)],
        "random": [random_motion(designer, random) for _ in range(RANDOM_POOL)],
    }
    times: dict[str, list[list[float]]] = {policy: [] for policy in POLICIES}
    for index, truth in enumerate(found):
        progress(f"{group.name}: running, where {truth.effects[0].name} holds")
        rivals = [one for one in found if one is not truth]
        cycles = {kind: [cycle(designer, truth, rivals, one) for one in those] for kind, those in planned.items()}
        cycles["ever new"] = cycles["random"]
        for policy in POLICIES:
            own = []
            for seed in range(seeds):
                random = np.random.default_rng([seed, index])
                those = cycles[policy]
                if policy == "ever new":
                    those = [those[k] for k in random.permutation(len(those))]
                else:
                    those = [those[seed % len(those)]]
                own.append(settled(designer, those, random))
            times[policy].append(own)
    sizes = [{e.name: {k: float(v) for k, v in e.values.items()} for e in model.effects} for model in found]
    return {"group": group.name, "sizes": sizes, "times": times}


def _designed(designer: Designer, value: Value, kept: Path, progress: Progress) -> Motion:
    """The motion of most value, its commands kept in a file; every policy's search starts from the same draws."""
    if not kept.is_file():
        commands = designer.design(value, np.random.default_rng(2), lambda text: progress(f"{kept.stem}: {text}"))
        write_text(kept, json.dumps(commands.commands.tolist()))
    return designer.motion(np.array(json.loads(kept.read_text()), dtype=float))


def summary(result: Mapping[str, object]) -> dict[str, float]:
    """By policy the median over seeds of the time s of whichever explanation takes longest."""
    times: Mapping[str, list[list[float]]] = result["times"]  # type: ignore[assignment]
    return {policy: float(np.median(np.max(np.array(one), axis=0))) for policy, one in times.items()}


def line(result: Mapping[str, object]) -> str:
    """The table's line."""
    median = summary(result)
    designed = median["designed"]
    of_random, of_d = designed / median["random"], designed / median["D-optimal"]
    seconds = "".join(f"{median[policy]:14.2f}" for policy in POLICIES[:3])
    holds = "holds" if of_random <= OF_RANDOM and of_d <= OF_D_OPTIMAL else "does not"
    return (
        f"{result['group']!s:30}{seconds}{of_random:14.2f}{of_d:14.2f}{holds:>14}{designed / median['ever new']:14.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", help="All, or some of them by their first word.")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/discrimination"))
    arguments = parser.parse_args()
    wanted = [g for g in GROUPS if not arguments.groups or any(g.name.startswith(word) for word in arguments.groups)]
    print(HEADER, flush=True)
    for group in wanted:
        kept = arguments.out / f"{group.slug}.json"
        if not kept.is_file():
            with progress_line() as progress:
                result = measure(group, arguments.seeds, arguments.out, progress)
            write_text(kept, json.dumps(result))
        print(line(json.loads(kept.read_text())), flush=True)


if __name__ == "__main__":
    main()
