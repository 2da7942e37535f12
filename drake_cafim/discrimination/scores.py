"""What a planner maximises: the odds that a motion is expected to bring, or the information in it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.discrimination.evidence import expected_log_odds, slopes
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.information import criterion
from drake_cafim.typing import Array


class Value(Protocol):
    """The worth of one planned motion."""

    def __call__(self, problem: Problem) -> float:
        """Larger is better."""
        ...


@dataclass(frozen=True)
class Odds:
    """Expected log Bayes factor in favour of whichever is true: the smallest over the pairs and both directions."""

    pairs: tuple[Pair, ...]

    def __call__(self, problem: Problem) -> float:
        return min(min(self.directions(problem, pair)) for pair in self.pairs)

    def directions(self, problem: Problem, pair: Pair) -> tuple[float, float]:
        """If the pair's first is true, and if its second is."""
        first, second = pair.first, pair.second
        return expected_log_odds(problem, first, second), expected_log_odds(problem, second, first)


@dataclass(frozen=True)
class Information:
    """½ (ln det(P + F) − ln det P) of unknowns and both models' strengths together: D-optimality."""

    pair: Pair

    def __call__(self, problem: Problem) -> float:
        fisher = self.fisher(problem)
        return float(criterion("logdet", fisher[None], np.eye(len(fisher)))[0])

    def fisher(self, problem: Problem) -> Array:
        """F (k, k) in coordinates whose prior is a unit normal."""
        present = {one.key for one in self.pair.first.effects}
        other = tuple(one for one in self.pair.second.effects if one.key not in present)
        nominal = self.pair.first.unknown
        columns = [slopes(problem, self.pair.first), slopes(problem, Model(nominal, other))[:, len(nominal) :]]
        J = np.concatenate(columns, axis=1)
        return np.asarray(J.T @ J)


@dataclass(frozen=True)
class MotionScore:
    """A planner's score: commands (N, points, n) within [−1, 1] as motions, each worth its `value`."""

    bench: Bench
    shape: Shape
    limits: Limits
    value: Value

    def __call__(self, commands: Array) -> Scored:
        physics = self.bench.scene.physics
        values = [self.value(self.bench.problem(plan(self.shape, self.limits, physics, one))) for one in commands]
        return Scored(np.array(values), np.zeros((len(commands), 0, 0)))
