"""Objectives of a planner: expected log odds, the rate at which odds are settled, or Fisher information."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from scipy.special import log_ndtr, ndtr

from drake_cafim.design.planner import Scored
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.evidence import (
    Course,
    Explained,
    expected,
    expected_log_odds,
    linearise,
    slopes,
)
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.information import criterion
from drake_cafim.typing import Array

TWENTY_TO_ONE = float(np.log(20.0))
REPEATS: Array = np.asarray(3.0 * 1.2 ** np.arange(28), dtype=float)
"""Numbers of repetitions of a motion at which the odds are evaluated: 3 to 400, closely enough for quadrature."""


class Value(Protocol):
    """The value of a planned motion."""

    def __call__(self, problem: WeakProblem) -> float:
        """The value of the motion with these whitened rows; larger is better."""
        ...


Courses: TypeAlias = Callable[[Pair], tuple[tuple[Course, Course], tuple[Course, Course]]]
"""Courses (true model, rival) along a motion: for the pair's first model as the truth, and for its second."""


class OddsValue(Value, Protocol):
    """A value that depends on the expected odds between the models of `pairs`, from plans or from simulated runs."""

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """The pairs of models to tell apart."""
        ...

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """The value for these courses, larger is better; `problem` gives the windows' end times."""
        ...


@dataclass(frozen=True)
class _PlannedCourses:
    """Models along a planned motion, each linearized only once."""

    problem: WeakProblem
    _known: dict[int, Explained] = field(default_factory=dict)

    def __call__(self, pair: Pair) -> tuple[tuple[Course, Course], tuple[Course, Course]]:
        """`Courses` of the planned motion itself."""
        first, second = self._at(pair.first), self._at(pair.second)
        return expected(self.problem, first, second), expected(self.problem, second, first)

    def _at(self, model: Model) -> Explained:
        if id(model) not in self._known:
            self._known[id(model)] = linearise(self.problem, model)
        return self._known[id(model)]


@dataclass(frozen=True)
class Odds:
    """Expected log Bayes factor in favour of whichever is true: the smallest over the pairs and both directions."""

    pairs: tuple[Pair, ...]

    def __call__(self, problem: WeakProblem) -> float:
        return self.of(problem, _PlannedCourses(problem))

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """The smallest expected log odds after one run of the motion."""
        return min(min(self._of(courses, pair)) for pair in self.pairs)

    def directions(self, problem: WeakProblem, pair: Pair) -> tuple[float, float]:
        """Expected log odds for the pair's first model as the truth, and for its second."""
        return self._of(_PlannedCourses(problem), pair)

    def _of(self, courses: Courses, pair: Pair) -> tuple[float, float]:
        first, second = (float(expected_log_odds(*side)[-1]) for side in courses(pair))
        return first, second


@dataclass(frozen=True)
class Soonest:
    """The rate 1/s at which odds are settled: the inverse of the geometric mean, over the noise, of the robot time
    after which `log_odds` have been reached for each model of the pairs as the truth, with the motion repeated.

    For linear rows the log odds are a Gaussian random walk with mean m(t) and variance 2 m(t). The probability that it
    has exceeded b is Φ((m − b)/√(2m)) + eᵇ Φ(−(m + b)/√(2m)) (Chhikara, Folks, The Inverse Gaussian Distribution,
    1989). A mean over this distribution is smooth in the motion; the time at which m passes b is not, since m hardly
    grows on the robot's way home. A geometric mean, like a median, is insensitive to the few runs that never settle.
    """

    pairs: tuple[Pair, ...]
    log_odds: float = TWENTY_TO_ONE

    def __call__(self, problem: WeakProblem) -> float:
        return self.of(problem, _PlannedCourses(problem))

    def of(self, problem: WeakProblem, courses: Courses) -> float:
        """The rate 1/s from the expected odds after each window."""
        settled = [chances for pair in self.pairs for chances in self._settled(courses, pair)]
        return 1.0 / _mean_time(_moments(problem), np.prod(settled, axis=0))

    def directions(self, problem: WeakProblem, pair: Pair) -> tuple[float, float]:
        """Geometric mean time s for the pair's first model as the truth, and for its second."""
        chances = self._settled(_PlannedCourses(problem), pair)
        first, second = (_mean_time(_moments(problem), settled) for settled in chances)
        return first, second

    def _settled(self, courses: Courses, pair: Pair) -> list[Array]:
        """Probabilities (K,) that odds are settled by each moment: first model true, and second model true."""
        return [passed(_repeated_log_odds(*side), self.log_odds) for side in courses(pair)]


def _moments(problem: WeakProblem) -> Array:
    """Robot times (K,) s: the ends of the windows of the first two runs, then the ends of `REPEATS` runs."""
    windows = problem.runs[0].weak.samples.windows
    duration = float(windows.time[-1] - windows.time[0])
    ends = windows.starts + windows.width - windows.time[0]
    return np.concatenate([ends, duration + ends, duration * REPEATS])


def _repeated_log_odds(truth: Course, rival: Course) -> Array:
    """The expected log odds (K,) at `_moments`."""
    first_two = [expected_log_odds(truth, rival), expected_log_odds(truth.after(truth), rival.after(rival))]
    return np.concatenate([*first_two, expected_log_odds(truth.repeated(REPEATS), rival.repeated(REPEATS))])


def passed(mean: Array, threshold: float) -> Array:
    """Probabilities (K,) that a random walk of mean `mean` (K,) and variance 2 `mean` has exceeded `threshold` > 0."""
    mean = np.maximum(mean, 1e-3)
    spread = np.sqrt(2.0 * mean)
    chance = ndtr((mean - threshold) / spread) + np.exp(threshold + log_ndtr(-(mean + threshold) / spread))
    return np.asarray(np.maximum.accumulate(chance))


def _mean_time(moments: Array, settled: Array) -> float:
    """exp E ln t, s, from the distribution function `settled` (K,) of t at `moments` (K,) s; t ≥ the first moment."""
    return float(moments[0] * np.exp(np.trapezoid(1.0 - settled, np.log(moments))))


@dataclass(frozen=True)
class Information:
    """½ (ln det(P + F) − ln det P) for the unknowns and all models' strengths jointly: D-optimality."""

    models: Sequence[Model]

    def __call__(self, problem: WeakProblem) -> float:
        J = np.concatenate(list(self._columns(problem)), axis=1)
        return float(criterion("logdet", (J.T @ J)[None], np.eye(J.shape[1]))[0])

    def _columns(self, problem: WeakProblem) -> Iterator[Array]:
        """Jacobian columns in coordinates with a unit normal prior: of the unknowns, and of each effect once."""
        known: set[tuple[str, str]] = set()
        for number, model in enumerate(self.models):
            new = tuple(effect for effect in model.effects if effect.key not in known)
            known |= {effect.key for effect in new}
            yield slopes(problem, Model(model.unknown, new))[:, len(model.unknown) if number else 0 :]


@dataclass(frozen=True)
class MotionScore:
    """A planner's score: the `value` of the motion of each of the commands (N, points, n) within [−1, 1].

    With `like`, its whitening is used for all motions.
    """

    bench: Bench
    shape: Shape
    limits: Limits
    value: Value
    like: WeakProblem | None = None

    def __call__(self, commands: Array) -> Scored:
        return Scored(np.array([self.of(candidate) for candidate in commands]), np.zeros((len(commands), 0, 0)))

    def of(self, commands: Array) -> float:
        """The value of the motion of `commands` (points, n)."""
        planned = plan(self.shape, self.limits, self.bench.scene.physics, commands)
        return self.value(self.bench.problem(planned, self.like))
