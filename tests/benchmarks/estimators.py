"""`python -m tests.benchmarks.estimators [--seeds N] [SCENARIO ...]`: the joint program's optimum beside shooting's.

The data are those of one experiment in the kinematic world, planned from a prior 30 % too high. `--estimator joint`
solves for parameters and contact forces together, begun at the shooting estimate; here also begun at the prior's mean,
as an estimate that does not know shooting's would be. The same optimum is one within a tenth of a std in every
parameter. What SNOPT says is counted as well: its success is no proof, nor is its failure.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.estimation.joint import MET, solve_joint
from drake_cafim.estimation.problem import Data, MapProblem, make_problem
from drake_cafim.estimation.shooting import MapEstimate, solve
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.studies.cell import SCENARIOS, TASKS
from drake_cafim.typing import Array

SAME = 0.1
"""Std, within which two optima are the same."""


@dataclass
class Tally:
    """Of one start: in how many runs the optimum is shooting's, a better one or a worse one, and SNOPT's words."""

    runs: int = 0
    same: int = 0
    better: int = 0
    said: Counter[str] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)

    def add(self, problem: MapProblem, shooting: MapEstimate, start: Array) -> None:
        """Solve the joint program from θ = `start` (n,) and count how it ends beside the `shooting` estimate."""
        began = time.perf_counter()
        joint = solve_joint(problem, start)
        self.seconds.append(time.perf_counter() - began)
        theta = problem.model.parameters.clip(joint.theta)
        away = np.abs(theta - shooting.belief.mean) / shooting.belief.std
        met = joint.violation <= MET
        self.runs += 1
        same = met and bool((away <= SAME).all())
        self.same += same
        self.better += met and not same and problem.cost(theta) < shooting.cost
        self.said[f"{joint.message.split(',')[0]}{'' if met else ', constraints not met'}"] += 1

    def __str__(self) -> str:
        words = ", ".join(f"{word}: {count}" for word, count in self.said.most_common())
        middle = np.median(self.seconds)
        return f"the same in {self.same} of {self.runs}, better in {self.better}; {words}; {middle:.2f} s"


def compare(name: str, seeds: int, *, soft: bool = False) -> dict[str, Tally]:
    """Tallies by start, of `seeds` runs; with `soft` of the scenario's own task, as hefting with a compliant palm."""
    task = (stage_of(load(resolve(name)), name).task if soft else TASKS[name]()).with_prior_mean(1.3)
    tallies = {"begun at shooting's": Tally(), "begun at the prior's mean": Tally()}
    for seed in range(seeds):
        done = run(task, Options(seed=seed, experiments=1, search=False)).experiments[0]
        problem = make_problem(task.model, TangentEvaluator(task.model), [Data(done.robot_states, done.measured_force)])
        shooting = solve(problem)
        for tally, start in zip(tallies.values(), (shooting.belief.mean, problem.prior.mean), strict=True):
            tally.add(problem, shooting, start)
    return tallies


def main() -> None:
    """Print a line for each scenario and start."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--soft", action="store_true", help="hefting with its compliant palm")
    options = parser.parse_args()
    for name in options.scenario:
        for start, tally in compare(name, options.seeds, soft=options.soft).items():
            print(f"{name}, {start}: {tally}", flush=True)


if __name__ == "__main__":
    main()
