"""What motions are worth by what becomes of them in simulation, each explanation being the truth in turn.

A plan can be judged by itself, as the nominal model moves. Where contacts or couplings take the robot off its plan, or
where rows of short windows follow a law only so closely, what runs bring is something else.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.discrimination.closed_loop import measured, simulated_together
from drake_cafim.discrimination.evidence import Course, Explained, explain, looked
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Motion
from drake_cafim.discrimination.planned import Bench
from drake_cafim.discrimination.scores import OddsValue
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

STEPS = 8
"""Of a rival's fit."""


@dataclass(frozen=True)
class Run:
    """A motion as it goes where `truth` holds: what noiseless sensors write of it, and its rows."""

    truth: Model
    recording: Recording
    problem: WeakProblem

    def courses(self, rival: Model) -> tuple[Course, Course]:
        """Of the truth, and of a rival about its best numbers."""
        best: Explained = explain(self.problem, rival, steps=STEPS)
        return Course.of(self.problem, looked(self.problem, self.truth)), Course.of(self.problem, best)


def runs(bench: Bench, limits: Limits, truth: Model, planned: Sequence[Motion]) -> list[Run]:
    """Of each motion, in closed loop."""
    scene, quiet = bench.scene, dict.fromkeys(bench.samples.std, 0.0)
    physics, random = truth.physics(scene), np.random.default_rng(0)
    found = []
    for run in simulated_together(physics, scene.physics, limits, planned):
        recording = measured(scene, physics, run, quiet, random, "rehearsed")
        found.append(Run(truth, recording, bench.reading(recording)))
    return found


@dataclass(frozen=True)
class Rehearsal:
    """The value of motions by their runs instead of their plans."""

    bench: Bench
    limits: Limits
    value: OddsValue

    def __call__(self, planned: Sequence[Motion]) -> Array:
        """(N,), of each motion."""
        models = {id(model): model for pair in self.value.pairs for model in (pair.first, pair.second)}
        by_truth = [runs(self.bench, self.limits, model, planned) for model in models.values()]
        return np.array([self._of(dict(zip(models, those, strict=True))) for those in zip(*by_truth, strict=True)])

    def _of(self, runs: dict[int, Run]) -> float:
        """Of one motion, by its runs where each model holds."""

        def courses(pair: Pair) -> tuple[tuple[Course, Course], tuple[Course, Course]]:
            return runs[id(pair.first)].courses(pair.second), runs[id(pair.second)].courses(pair.first)

        value = self.value.of(next(iter(runs.values())).problem, courses)
        return value if np.isfinite(value) else -np.inf
