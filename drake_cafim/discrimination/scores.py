"""What a planner maximises: the odds that a motion is expected to bring, or the information in it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.discrimination.evidence import Course, expected, expected_log_odds, slopes
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.information import criterion
from drake_cafim.typing import Array

TWENTY_TO_ONE = float(np.log(20.0))
REPEATS = tuple(range(24))
"""Whole motions before the one in which odds are settled."""


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
        sides = ((pair.first, pair.second), (pair.second, pair.first))
        first, second = (float(expected_log_odds(*expected(problem, *side))[-1]) for side in sides)
        return first, second


@dataclass(frozen=True)
class Soonest:
    """The rate 1/s at which odds are settled: one over the robot time after which `log_odds` are expected for
    whichever is true, the motion being run again and again."""

    pairs: tuple[Pair, ...]
    log_odds: float = 2.0 * TWENTY_TO_ONE
    """More than is asked for: noise spreads odds, and a motion that only just gets there often does not."""

    def __call__(self, problem: Problem) -> float:
        return 1.0 / max(max(self.directions(problem, pair)) for pair in self.pairs)

    def directions(self, problem: Problem, pair: Pair) -> tuple[float, float]:
        """Robot time s if the pair's first is true, and if its second is."""
        sides = ((pair.first, pair.second), (pair.second, pair.first))
        first, second = (self._time(problem, *expected(problem, *side)) for side in sides)
        return first, second

    def _time(self, problem: Problem, own: Course, other: Course) -> float:
        time = problem.runs[0].weak.samples.time
        duration = float(time[-1] - time[0])
        ends = problem.runs[0].weak.samples.windows.starts + problem.runs[0].weak.samples.windows.width - time[0]
        for repeats in REPEATS:
            reached = expected_log_odds(own.after(own, repeats), other.after(other, repeats))
            over = np.flatnonzero(reached >= self.log_odds)
            if len(over):
                k = int(over[0])
                low = float(reached[k - 1]) if k else 0.0
                # between windows as if odds rose evenly: a planner follows slopes
                share = float(np.clip((self.log_odds - low) / max(reached[k] - low, 1e-12), 0.0, 1.0))
                begun = float(ends[k - 1]) if k else 0.0
                return repeats * duration + begun + share * (float(ends[k]) - begun)
        return (REPEATS[-1] + 1) * duration * max(self.log_odds / max(float(reached[-1]), 1e-3), 1.0)


@dataclass(frozen=True)
class Information:
    """½ (ln det(P + F) − ln det P) of unknowns and all models' strengths together: D-optimality."""

    models: Sequence[Model]

    def __call__(self, problem: Problem) -> float:
        J = np.concatenate(list(self._columns(problem)), axis=1)
        return float(criterion("logdet", (J.T @ J)[None], np.eye(J.shape[1]))[0])

    def _columns(self, problem: Problem) -> Iterator[Array]:
        """Slopes in coordinates whose prior is a unit normal: of the unknowns, and of each effect once."""
        known: set[tuple[str, str]] = set()
        for number, model in enumerate(self.models):
            new = tuple(one for one in model.effects if one.key not in known)
            known |= {one.key for one in new}
            yield slopes(problem, Model(model.unknown, new))[:, len(model.unknown) if number else 0 :]


@dataclass(frozen=True)
class MotionScore:
    """A planner's score: commands (N, points, n) within [−1, 1] as motions, each worth its `value`.

    All are whitened as `like`, where it is given.
    """

    bench: Bench
    shape: Shape
    limits: Limits
    value: Value
    like: Problem | None = None

    def __call__(self, commands: Array) -> Scored:
        planned = [plan(self.shape, self.limits, self.bench.scene.physics, one) for one in commands]
        values = [self.value(self.bench.problem(one, self.like)) for one in planned]
        return Scored(np.array(values), np.zeros((len(commands), 0, 0)))
