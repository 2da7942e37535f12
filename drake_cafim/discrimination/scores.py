"""What a planner maximises: the odds that a motion is expected to bring, or the information in it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from scipy.special import log_ndtr, ndtr

from drake_cafim.design.planner import Scored
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.weak_problem import WeakProblem
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
REPEATS: Array = np.asarray(3.0 * 1.2 ** np.arange(28), dtype=float)
"""Of a motion, after which its odds are looked at: to some hundred runs, closely enough for an integral."""


class Value(Protocol):
    """The worth of one planned motion."""

    def __call__(self, problem: WeakProblem) -> float:
        """Larger is better."""
        ...


Courses: TypeAlias = Callable[[Pair], tuple[tuple[Course, Course], tuple[Course, Course]]]
"""Of the true model and of its rival along one motion, if the pair's first is true, and if its second is."""


class OddsValue(Value, Protocol):
    """A worth that lies in the odds between the explanations of `pairs`, however these were foreseen."""

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """To be told apart."""
        ...

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """Larger is better; `problem` says when windows end."""
        ...


@dataclass(frozen=True)
class _Looks:
    """Models along one planned motion, each looked at once."""

    problem: WeakProblem
    _known: dict[int, Explained] = field(default_factory=dict)

    def __call__(self, pair: Pair) -> tuple[tuple[Course, Course], tuple[Course, Course]]:
        """`Courses` of the planned motion itself."""
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

    def __call__(self, problem: WeakProblem) -> float:
        return self.of(problem, _Looks(problem))

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """By the odds after one motion."""
        return min(min(self._of(courses, pair)) for pair in self.pairs)

    def directions(self, problem: WeakProblem, pair: Pair) -> tuple[float, float]:
        """If the pair's first is true, and if its second is."""
        return self._of(_Looks(problem), pair)

    def _of(self, courses: Courses, pair: Pair) -> tuple[float, float]:
        first, second = (float(expected_log_odds(*side)[-1]) for side in courses(pair))
        return first, second


@dataclass(frozen=True)
class Soonest:
    """The rate 1/s at which odds are settled: one over the robot time that passes, in the geometric mean over noise and
    the motion being run again and again, until `log_odds` were reached for each explanation of the pairs, were it true.

    Where rows are linear, noise makes of ln odds a normal walk with twice its mean m(t) for variance. The chance that
    it has been beyond b is Φ((m − b)/√(2m)) + eᵇ Φ(−(m + b)/√(2m)) (Chhikara, Folks, The Inverse Gaussian Distribution,
    1989). A mean over these chances is smooth in the motion, as the moment at which m passes b is not: m hardly rises
    on a robot's way home. The geometric one, as a median, cares little about the few runs that never end.
    """

    pairs: tuple[Pair, ...]
    log_odds: float = TWENTY_TO_ONE

    def __call__(self, problem: WeakProblem) -> float:
        return self.of(problem, _Looks(problem))

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """By the odds after each window."""
        settled = [one for pair in self.pairs for one in self._settled(courses, pair)]
        return 1.0 / _waited(_moments(problem), np.prod(settled, axis=0))

    def directions(self, problem: WeakProblem, pair: Pair) -> tuple[float, float]:
        """Expected robot time s if the pair's first is true, and if its second is."""
        first, second = (_waited(_moments(problem), one) for one in self._settled(_Looks(problem), pair))
        return first, second

    def _settled(self, courses: Courses, pair: Pair) -> list[Array]:
        """The chances (K,) that odds were settled by each moment, if the first is true, and if the second is."""
        return [passed(_again_and_again(*side), self.log_odds) for side in courses(pair)]


def _moments(problem: WeakProblem) -> Array:
    """Robot time s (K,): when windows of the first two runs are over, then when further runs are."""
    windows = problem.runs[0].weak.samples.windows
    duration = float(windows.time[-1] - windows.time[0])
    ends = windows.starts + windows.width - windows.time[0]
    return np.concatenate([ends, duration + ends, duration * REPEATS])


def _again_and_again(own: Course, other: Course) -> Array:
    """The log odds (K,) that are expected at `_moments`."""
    again = [expected_log_odds(own, other), expected_log_odds(own.after(own), other.after(other))]
    return np.concatenate([*again, expected_log_odds(own.repeated(REPEATS), other.repeated(REPEATS))])


def passed(mean: Array, threshold: float) -> Array:
    """The chances (K,) that a walk which is expected to be at `mean` (K,) has been beyond `threshold` (> 0)."""
    mean = np.maximum(mean, 1e-3)
    spread = np.sqrt(2.0 * mean)
    chance = ndtr((mean - threshold) / spread) + np.exp(threshold + log_ndtr(-(mean + threshold) / spread))
    return np.asarray(np.maximum.accumulate(chance))


def _waited(moments: Array, settled: Array) -> float:
    """exp E ln t s, from the chances that t is over at `moments` (K,) s; before the first of them nothing is."""
    return float(moments[0] * np.exp(np.trapezoid(1.0 - settled, np.log(moments))))


@dataclass(frozen=True)
class Information:
    """½ (ln det(P + F) − ln det P) of unknowns and all models' strengths together: D-optimality."""

    models: Sequence[Model]

    def __call__(self, problem: WeakProblem) -> float:
        J = np.concatenate(list(self._columns(problem)), axis=1)
        return float(criterion("logdet", (J.T @ J)[None], np.eye(J.shape[1]))[0])

    def _columns(self, problem: WeakProblem) -> Iterator[Array]:
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
    like: WeakProblem | None = None

    def __call__(self, commands: Array) -> Scored:
        return Scored(np.array([self.of(one) for one in commands]), np.zeros((len(commands), 0, 0)))

    def of(self, commands: Array) -> float:
        """Of one motion, (points, n)."""
        planned = plan(self.shape, self.limits, self.bench.scene.physics, commands)
        return self.value(self.bench.problem(planned, self.like))
