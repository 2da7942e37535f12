"""What a planner maximises: the odds that a motion is expected to bring, or the information in it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.discrimination.evidence import (
    Course,
    Explained,
    expected,
    expected_log_odds,
    looked,
    slopes,
)
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.information import criterion
from drake_cafim.typing import Array

TWENTY_TO_ONE = float(np.log(20.0))
REPEATS = 24
"""Motions after which odds are as if they went on rising evenly."""


class Value(Protocol):
    """The worth of one planned motion."""

    def __call__(self, problem: Problem) -> float:
        """Larger is better."""
        ...


@dataclass(frozen=True)
class _Looks:
    """Models along one planned motion, each looked at once."""

    problem: Problem
    _known: dict[int, Explained] = field(default_factory=dict)

    def courses(self, pair: Pair) -> tuple[tuple[Course, Course], tuple[Course, Course]]:
        """Of the true model and of its rival, if the pair's first is true, and if its second is."""
        first, second = self._at(pair.first), self._at(pair.second)
        return expected(self.problem, first, second), expected(self.problem, second, first)

    def _at(self, model: Model) -> Explained:
        if id(model) not in self._known:
            self._known[id(model)] = looked(self.problem, model)
        return self._known[id(model)]


@dataclass(frozen=True)
class Odds:
    """Expected log Bayes factor in favour of whichever is true: the smallest over the pairs and both directions."""

    pairs: tuple[Pair, ...]

    def __call__(self, problem: Problem) -> float:
        looks = _Looks(problem)
        return min(min(self._of(looks, pair)) for pair in self.pairs)

    def directions(self, problem: Problem, pair: Pair) -> tuple[float, float]:
        """If the pair's first is true, and if its second is."""
        return self._of(_Looks(problem), pair)

    def _of(self, looks: _Looks, pair: Pair) -> tuple[float, float]:
        first, second = (float(expected_log_odds(*side)[-1]) for side in looks.courses(pair))
        return first, second


@dataclass(frozen=True)
class Soonest:
    """The rate 1/s at which odds are settled: one over the robot time after which `log_odds` are expected for
    whichever is true, the motion being run again and again."""

    pairs: tuple[Pair, ...]
    log_odds: float = 2.0 * TWENTY_TO_ONE
    """More than is asked for: noise spreads odds, and a motion that only just gets there often does not."""

    def __call__(self, problem: Problem) -> float:
        looks = _Looks(problem)
        return 1.0 / max(max(self._of(looks, pair)) for pair in self.pairs)

    def directions(self, problem: Problem, pair: Pair) -> tuple[float, float]:
        """Robot time s if the pair's first is true, and if its second is."""
        return self._of(_Looks(problem), pair)

    def _of(self, looks: _Looks, pair: Pair) -> tuple[float, float]:
        first, second = (self._time(looks.problem, *side) for side in looks.courses(pair))
        return first, second

    def _time(self, problem: Problem, own: Course, other: Course) -> float:
        windows = problem.runs[0].weak.samples.windows
        duration = float(windows.time[-1] - windows.time[0])
        whole = expected_log_odds(own.repeated(REPEATS), other.repeated(REPEATS))
        enough = np.flatnonzero(whole >= self.log_odds)
        if not len(enough):
            return REPEATS * duration * max(self.log_odds / max(float(whole[-1]), 1e-3), 1.0)
        repeats = int(enough[0])
        reached = expected_log_odds(own.after(own, repeats), other.after(other, repeats))
        ends = windows.starts + windows.width - windows.time[0]
        k = int(np.flatnonzero(reached >= self.log_odds)[0])
        low = float(reached[k - 1]) if k else (float(whole[repeats - 1]) if repeats else 0.0)
        # between windows as if odds rose evenly: a planner follows slopes
        share = float(np.clip((self.log_odds - low) / max(reached[k] - low, 1e-12), 0.0, 1.0))
        begun = float(ends[k - 1]) if k else 0.0
        return repeats * duration + begun + share * (float(ends[k]) - begun)


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
