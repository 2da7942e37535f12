"""The value of motions by closed-loop simulation, with each explanation in turn as the truth.

The value of a plan assumes that the robot moves as the nominal model. Where contacts or couplings make it deviate from
the plan, or the rows of short windows approximate a law poorly, the value of its simulated runs differs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.closed_loop import measured, simulated_together
from drake_cafim.discrimination.evidence import Course, Explained, explain, linearise
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Motion
from drake_cafim.discrimination.planned import Bench
from drake_cafim.discrimination.scores import OddsValue
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Run:
    """A simulated run in which `truth` holds: its noiseless recording and whitened rows."""

    truth: Model
    recording: Recording
    problem: WeakProblem

    def courses(self, rival: Model) -> tuple[Course, Course]:
        """The course of the truth, and that of a rival linearized at its fit."""
        best: Explained = explain(self.problem, rival)
        return Course.of(self.problem, linearise(self.problem, self.truth)), Course.of(self.problem, best)


def runs(bench: Bench, limits: Limits, truth: Model, planned: Sequence[Motion]) -> list[Run]:
    """The closed-loop simulation of each planned motion, with `truth` as the robot's physics."""
    scene, quiet = bench.scene, dict.fromkeys(bench.samples.std, 0.0)
    physics, random = truth.physics(scene), np.random.default_rng(0)
    found = []
    for run in simulated_together(physics, scene.physics, limits, planned):
        recording = measured(scene, physics, run, quiet, random, "rehearsed")
        found.append(Run(truth, recording, bench.reading(recording)))
    return found


@dataclass(frozen=True)
class Rehearsal:
    """The value of motions by their simulated runs instead of their plans."""

    bench: Bench
    limits: Limits
    value: OddsValue

    def __call__(self, planned: Sequence[Motion]) -> Array:
        """The values (N,) of the motions."""
        models = {id(model): model for pair in self.value.pairs for model in (pair.first, pair.second)}
        by_truth = [runs(self.bench, self.limits, model, planned) for model in models.values()]
        return np.array([self._of(dict(zip(models, runs_of, strict=True))) for runs_of in zip(*by_truth, strict=True)])

    def _of(self, runs: dict[int, Run]) -> float:
        """The value of a motion by its runs, keyed by the id of the model that is the truth."""

        def courses(pair: Pair) -> tuple[tuple[Course, Course], tuple[Course, Course]]:
            return runs[id(pair.first)].courses(pair.second), runs[id(pair.second)].courses(pair.first)

        value = self.value.of(next(iter(runs.values())).problem, courses)
        return value if np.isfinite(value) else -np.inf
