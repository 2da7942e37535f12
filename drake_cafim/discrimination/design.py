"""The motion that tells two explanations apart, by the planners that design experiments."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.design.iterative import CrossEntropy
from drake_cafim.design.planner import Planner, PlannerConfig, candidate_commands
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.discrimination.evidence import explain
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Motion, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.discrimination.scores import MotionScore, Value
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

QUIET = 0.25
"""Part of its range that an ordinary motion uses."""
SEEN = 5.0

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Effort:
    """How long to plan: `rounds` of a planner with `config`, each from the best of the last."""

    config: PlannerConfig
    rounds: int = 4


def default_effort(shape: Shape) -> Effort:
    """A cross-entropy search of some hundred motions."""
    return Effort(
        PlannerConfig(
            candidates=80, horizon=shape.points, knots=shape.points // 2, knot_std=0.6, iterations=5, elites=0.25
        )
    )


@dataclass(frozen=True)
class Design:
    """A planned motion, its commands (points, n), and what its planner's value of it is."""

    planned: Motion
    commands: Array
    value: float


@dataclass(frozen=True)
class Designer:
    """All that designs of one scene share."""

    scene: Scene
    shape: Shape
    limits: Limits
    bench: Bench
    effort: Effort = field(repr=False)

    @classmethod
    def of(cls, scene: Scene, shape: Shape | None = None, effort: Effort | None = None) -> "Designer":
        """Raises `InputError` for a scene whose channels or limits leave nothing to design."""
        shape = shape or Shape()
        limits = Limits.of(scene.tree)
        still = plan(shape, limits, scene.physics, np.zeros((shape.points, len(limits.home))))
        return cls(scene, shape, limits, Bench.of(scene, still), effort or default_effort(shape))

    def motion(self, commands: Array) -> Motion:
        return plan(self.shape, self.limits, self.scene.physics, commands)

    def problem(self, planned: Motion) -> Problem:
        return self.bench.problem(planned)

    @property
    def bounds(self) -> tuple[Array, Array]:
        one = np.ones(len(self.limits.home))
        return -one, one

    def random_commands(self, random: np.random.Generator) -> Array:
        """Commands (points, n) of a spline with knots anywhere within the limits."""
        knots = random.uniform(*self.bounds, size=(self.effort.config.knots, len(self.limits.home)))
        return np.asarray(candidate_commands(knots[None], self.shape.points, self.bounds)[0])

    def ordinary_motion(self, random: np.random.Generator) -> Motion:
        """A motion such as a recording may hold that could not tell: random, over a quarter of the range."""
        return self.motion(QUIET * self.random_commands(random))

    def matched(self, pair: Pair, random: np.random.Generator) -> Pair:
        """The pair with the second model's strengths as an ordinary recording would leave them, were the first true.

        In that recording the first shows at `SEEN` standard deviations, hardly more than it takes to be noticed; what
        it does not say of the second's strengths, their priors do.
        """
        problem = self.problem(self.ordinary_motion(random))
        nominal = problem.residual(problem.nominal())[: problem.rows]
        truth = problem.residual(pair.first)[: problem.rows]
        shown = float(np.linalg.norm(truth - nominal))
        found = explain(problem, pair.second, truth, weight=SEEN / shown if shown > 0.0 else 1.0).model
        return Pair(pair.first, Model(pair.first.unknown, found.effects))

    def design(self, value: Value, random: np.random.Generator, progress: Progress = lambda text: None) -> Design:
        """The motion of most `value` that the planner finds."""
        planner: Planner = CrossEntropy(self.effort.config)
        score = MotionScore(self.bench, self.shape, self.limits, value)
        knots = np.zeros((self.effort.config.knots, len(self.limits.home)))
        best: tuple[float, Array] | None = None
        for number in range(self.effort.rounds):
            progress(f"designing, round {number + 1} of {self.effort.rounds}")
            found = planner(knots, score, self.bounds, random)
            knots, worth = found.knots, float(np.max(found.scores))
            if best is None or worth > best[0]:
                best = worth, found.commands
        assert best is not None
        return Design(self.motion(best[1]), best[1], best[0])
