"""How soon motions tell confusable explanations apart: designed, D-optimal and random ones, with noise.

    python -m tests.benchmarks.discrimination [--seeds 20] [--out cafim-out/discrimination] [GROUP ...]

prints the table. For each explanation of a group, were it true, each motion is simulated in closed loop, again and
again, and recorded with noise; the robot time after which the odds for the truth against each of its rivals are over
20 : 1 is counted. A group's time for a seed is that of the explanation that takes longest.

All motions are cycles from rest to rest, of 1, 2 or 4 s as explanations are quick or slow, run again and
again. There are two D-optimal ones, of the most ln det F: in the scenario's unknown parameters, as experiments are
designed that do not discriminate, and in all explanations' strengths too, which is harder to beat. Their search is the
designed one's, with its budget and its first draws; both are among the first candidates of the designed one's and
among those that it rehearses in simulation. It maximises what motions are expected to bring, and sees none of the
noise that is counted here. Random ones
are drawn as the package's random policy draws them, velocities through random knots up to the joints' limits: six, and
each seed repeats one of them. The last column is of runs that take another of the six each time instead. The controller
reads the joints without noise, so that a motion's seeds share one simulation; noise is on all that is recorded. Odds
along a run are those of its noisy data, each explanation refitted to first order about its best numbers for the data
without noise.

What was finished stands in the folder and is not done again.
"""

from __future__ import annotations

import argparse
import functools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.cli import progress_line
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.discrimination.closed_loop import noisy
from drake_cafim.discrimination.design import Designer, Progress
from drake_cafim.discrimination.evidence import Course, Explained, explain, linearise
from drake_cafim.discrimination.motions import Motion
from drake_cafim.discrimination.rehearsal import Run, runs
from drake_cafim.discrimination.scores import TWENTY_TO_ONE, Information, Soonest, Value
from drake_cafim.output import write_text
from drake_cafim.typing import Array

from .confusable import GROUPS, Group, models, pairs, random_motion

CYCLES = 64
"""Motions of a run after which it is given up."""
RANDOM_POOL = 6
"""Different random motions."""
UNKNOWNS, STRENGTHS = "D-optimal in unknowns", "D-optimal in strengths too"
POLICIES = ("designed", UNKNOWNS, STRENGTHS, "random", "ever new")
LIMITS = {UNKNOWNS: 2 / 3, STRENGTHS: 2 / 3, "random": 1 / 3}
"""What the designed motion's time may be of another's."""
HEADER = f"{'':30}{'designed, s':>12}" + "".join(f"{name + ', s':>30}" for name in LIMITS) + f"{'of ever new':>14}"


@dataclass(frozen=True)
class Cycle:
    """One motion as it goes where an explanation holds, and every explanation about its own best numbers."""

    run: Run
    explained: tuple[Explained, ...]  # the truth first


def cycles(designer: Designer, truth: Model, rivals: Sequence[Model], planned: Sequence[Motion]) -> list[Cycle]:
    """Of each motion."""
    found = []
    for run in runs(designer.bench, designer.limits, truth, planned):
        explained = (explain(run.problem, rival) for rival in rivals)
        found.append(Cycle(run, (linearise(run.problem, truth), *explained)))
    return found


def settled(designer: Designer, cycles: Sequence[Cycle], random: np.random.Generator) -> float:
    """The robot time s after which the odds for the truth are over 20 : 1 against each rival."""
    windows = cycles[0].run.problem.runs[0].weak.samples.windows
    ends, duration = windows.starts + windows.width - windows.time[0], designer.shape.duration
    so_far: list[Course] | None = None
    for number in range(CYCLES):
        cycle = cycles[number % len(cycles)]
        recording = noisy(designer.scene, cycle.run.recording, designer.bench.samples.std, random)
        problem = designer.bench.reading(recording, cycle.run.problem)
        courses = []
        for explained in cycle.explained:
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
    designer = Designer.of(group.scene(out / "machines" / group.slug), group.shape)
    progress(f"{group.name}: sizes")
    found = models(group, designer, np.random.default_rng(0))
    random = np.random.default_rng(1)
    planned = {"random": [random_motion(designer, random) for _ in range(RANDOM_POOL)]}
    planned |= {policy: [item] for policy, item in designs(group, designer, found, out, progress).items()}
    times: dict[str, list[list[float]]] = {policy: [] for policy in POLICIES}
    for index, truth in enumerate(found):
        progress(f"{group.name}: running, where {truth.effects[0].name} holds")
        rivals = [item for item in found if item is not truth]
        motions = [item for those in planned.values() for item in those]
        done = iter(cycles(designer, truth, rivals, motions))
        run = {policy: [next(done) for _ in those] for policy, those in planned.items()}
        run["ever new"] = run["random"]
        for policy in POLICIES:
            own = []
            for seed in range(seeds):
                random = np.random.default_rng([seed, index])
                those = run[policy]
                if policy == "ever new":
                    those = [those[k] for k in random.permutation(len(those))]
                else:
                    those = [those[seed % len(those)]]
                own.append(settled(designer, those, random))
            times[policy].append(own)
    sizes = [{e.name: {k: float(v) for k, v in e.values.items()} for e in model.effects} for model in found]
    return {"group": group.name, "sizes": sizes, "times": times}


def designs(
    group: Group, designer: Designer, found: Sequence[Model], out: Path, progress: Progress
) -> dict[str, Motion]:
    """The motion of each policy that designs one; the designed one's search knows what the other two found."""

    def told(stem: str, text: str) -> None:
        progress(f"{stem}: {text}")

    def best(policy: str, value: Value, starts: Sequence[Array] = ()) -> Array:
        kept = out / f"{group.slug}_{policy.replace(' ', '_')}.json"
        if not kept.is_file():
            # every policy's search starts from the same draws
            search = np.random.default_rng(2)
            tell = functools.partial(told, kept.stem)
            design = designer.design(value, search, tell, starts)
            if isinstance(value, Soonest):
                design = designer.rehearse(value, design, search, tell, starts)
            write_text(kept, json.dumps(design.knots.tolist()))
        return np.array(json.loads(kept.read_text()), dtype=float)

    informative = [
        best(UNKNOWNS, Information((Model(designer.scene.priors.mean),))),
        best(STRENGTHS, Information(found)),
    ]
    knots = [best("designed", Soonest(pairs(found)), informative), *informative]
    return {policy: designer.motion(designer.commands(knot)) for policy, knot in zip(POLICIES, knots, strict=False)}


def summary(result: Mapping[str, object]) -> dict[str, float]:
    """By policy the median over seeds of the time s of whichever explanation takes longest."""
    times: Mapping[str, list[list[float]]] = result["times"]  # type: ignore[assignment]
    return {policy: float(np.median(np.max(np.array(values), axis=0))) for policy, values in times.items()}


def line(result: Mapping[str, object]) -> str:
    """The table's line: seconds, what the designed motion's are of them, and whether that is little enough."""
    median = summary(result)
    designed = median["designed"]
    cells = [f"{result['group']!s:30}{designed:12.2f}"]
    for policy, most in LIMITS.items():
        share = designed / median[policy]
        cells.append(f"{median[policy]:.2f} ({share:.2f} {'holds' if share <= most else 'does not'})".rjust(30))
    return "".join(cells) + f"{designed / median['ever new']:14.2f}"


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
