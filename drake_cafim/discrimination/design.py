"""Optimal design of the motion that tells two explanations apart, by the planners of `drake_cafim.design`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.design.planner import PlannerConfig, PlannerName, candidate_commands
from drake_cafim.design.policies import make_planner
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.cloud import Cloud
from drake_cafim.discrimination.evidence import explain
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.motions import Limits, Motion, Shape, plan
from drake_cafim.discrimination.planned import Bench
from drake_cafim.discrimination.rehearsal import Rehearsal
from drake_cafim.discrimination.scores import MotionScore, OddsValue, Value
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

NEARER = 0.125
"""Ratio of the last planner round's knot std to the first round's."""
QUIET = 0.25
"""Fraction of each joint's range that an ordinary motion uses."""
SEEN = 5.0
"""Standard deviations at which the true effect shows in an ordinary recording: about what detection needs."""
MOST_GENERATIONS = 80
SPREAD = 0.4
"""Initial scale of CMA-ES about the planner's best motion, in units of half a joint's range."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Effort:
    """The planning budget: `rounds` of a planner with `config`, each started from the best so far with a smaller std.

    `config.knot_std`, in units of half a joint's range, is that of the first round; the last round's is an eighth.
    CMA-ES with `config.candidates` per generation follows, for `generations` on the plan's value and for `rehearsals`
    generations on the value in simulation.
    """

    config: PlannerConfig
    rounds: int = 4
    generations: int = MOST_GENERATIONS
    rehearsals: int = 10
    planner: PlannerName = "predictive-sampling"

    def config_of(self, number: int) -> PlannerConfig:
        """The planner's configuration in round `number`, from 0."""
        share = number / max(self.rounds - 1, 1)
        return replace(self.config, knot_std=self.config.knot_std * NEARER**share)


def default_effort(shape: Shape, planner: PlannerName = "predictive-sampling") -> Effort:
    """The default budget, of some thousand candidate motions."""
    config = PlannerConfig(candidates=16, horizon=shape.points, knots=max(shape.points, 4), knot_std=0.6)
    return Effort(config, generations=min(4 * shape.points, MOST_GENERATIONS), planner=planner)


@dataclass(frozen=True)
class Design:
    """A planned motion, its commands (points, n), the knots (K, n) of their spline, and its value.

    `cloud` is the CMA-ES distribution of the knots at the end of the search.
    """

    planned: Motion
    commands: Array
    knots: Array
    value: float
    cloud: Cloud | None = None


@dataclass(frozen=True)
class Designer:
    """Designs motions for one scene: their shape, limits, bench and planning budget."""

    scene: Scene
    shape: Shape
    limits: Limits
    bench: Bench
    effort: Effort = field(repr=False)

    @classmethod
    def of(cls, scene: Scene, shape: Shape | None = None, effort: Effort | None = None) -> "Designer":
        """The designer for a scene; defaults for `shape` and `effort`.

        Raises `InputError` where the scenario does not state a channel's noise, or the robot cannot stay at home.
        """
        shape = shape or Shape()
        limits = Limits.of(scene.tree)
        still = plan(shape, limits, scene.physics, np.zeros((shape.points, len(limits.home))))
        return cls(scene, shape, limits, Bench.of(scene, still), effort or default_effort(shape))

    def motion(self, commands: Array) -> Motion:
        """The motion of `commands` (points, n)."""
        return plan(self.shape, self.limits, self.scene.physics, commands)

    def problem(self, planned: Motion) -> WeakProblem:
        """The planned motion's whitened rows, with the nominal model's predictions as data."""
        return self.bench.problem(planned)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (n,) of the commands: −1 and 1."""
        upper = np.ones(len(self.limits.home))
        return -upper, upper

    def random_commands(self, random: np.random.Generator) -> Array:
        """Commands (points, n) of a spline with knots drawn uniformly within the bounds."""
        commands: Array = self._commands(self._random_knots(self.effort.config.knots, 1, random))[0]
        return commands

    def _random_knots(self, smoothness: int, count: int, random: np.random.Generator) -> Array:
        """Knots (count, K, n) of random splines through `smoothness` uniform points; fewer points are smoother."""
        knots = random.uniform(*self.bounds, size=(count, smoothness, len(self.limits.home)))
        return np.asarray(candidate_commands(knots, self.effort.config.knots, self.bounds))

    def commands(self, knots: Array) -> Array:
        """Commands (points, n) on the spline through knots (K, n)."""
        return np.asarray(self._commands(knots[None])[0])

    def _commands(self, knots: Array) -> Array:
        return np.asarray(candidate_commands(knots, self.shape.points, self.bounds))

    def ordinary_motion(self, random: np.random.Generator) -> Motion:
        """A random motion over a quarter of the range, as in a recording that cannot tell the explanations apart."""
        return self.motion(QUIET * self.random_commands(random))

    def matched(self, pair: Pair, random: np.random.Generator) -> Pair:
        """The pair with the second model's strengths fitted to an ordinary recording in which the first is true.

        In that recording the first effect shows at `SEEN` standard deviations or less; strengths of the second that
        it does not determine stay at their priors. Where the second model explains less than half of the misfit that
        the unknown parameters leave, the pair is returned unchanged, as the fit would make the second effect vanish.
        """
        problem = self.problem(self.ordinary_motion(random))
        nominal = problem.residual(problem.nominal())[: problem.rows]
        truth = problem.residual(pair.first)[: problem.rows]
        shown = float(np.linalg.norm(truth - nominal))
        weight = min(SEEN / max(shown, 1e-12), 1.0)
        found = explain(problem, pair.second, truth, weight=weight)
        neither = explain(problem, pair.common, truth, weight=weight)
        if found.misfit > 0.5 * neither.misfit:
            return pair
        return Pair(pair.first, Model(pair.first.unknown, found.model.effects))

    def design(
        self,
        value: Value,
        random: np.random.Generator,
        progress: Progress = lambda text: None,
        starts: Sequence[Array] = (),
    ) -> Design:
        """The motion of largest `value` as planned; `starts`, knots (K, n), are among the first candidates."""
        effort = self.effort
        best = self._first(value, random, starts)
        for number in range(effort.rounds):
            progress(f"designing, round {number + 1} of {effort.rounds}")
            planner = make_planner(effort.planner, effort.config_of(number))
            found = planner(best.knots, self._score(value, best.planned), self.bounds, random)
            best = self._better(value, best, found.knots)
        cloud = Cloud.about(best.knots.ravel(), SPREAD)
        for number in range(effort.generations):
            progress(f"refining, generation {number + 1} of {effort.generations}")
            drawn = cloud.drawn(effort.config.candidates, random)
            knots = drawn.reshape(-1, *best.knots.shape)
            scores = self._score(value, best.planned)(self._commands(knots)).scores
            cloud = cloud.after(drawn, scores)
            best = self._better(value, best, knots[int(np.argmax(scores))])
        return replace(best, cloud=cloud)

    def rehearse(
        self,
        value: OddsValue,
        found: Design,
        random: np.random.Generator,
        progress: Progress = lambda text: None,
        starts: Sequence[Array] = (),
    ) -> Design:
        """The motion near `found`, or near one of `starts`, of largest `value` in closed-loop simulation."""
        rehearsal = self.rehearsal(value)
        finalists = np.stack([found.knots, *starts])
        progress("rehearsing")
        scores = rehearsal(self._motions(finalists))
        best, worth = finalists[int(np.argmax(scores))], float(np.max(scores))
        cloud = replace(found.cloud or Cloud.about(best.ravel(), SPREAD), mean=best.ravel())
        for number in range(self.effort.rehearsals):
            progress(f"rehearsing, round {number + 1} of {self.effort.rehearsals}")
            drawn = cloud.drawn(self.effort.config.candidates, random)
            knots = drawn.reshape(-1, *best.shape)
            scores = rehearsal(self._motions(knots))
            cloud = cloud.after(drawn, scores)
            if scores.max() > worth:
                best, worth = knots[int(np.argmax(scores))], float(scores.max())
        commands = self.commands(best)
        return Design(self.motion(commands), commands, best, worth, cloud)

    def rehearsal(self, value: OddsValue) -> Rehearsal:
        """The function that evaluates `value` by closed-loop simulation."""
        return Rehearsal(self.bench, self.limits, value)

    def _motions(self, knots: Array) -> list[Motion]:
        return [self.motion(commands) for commands in self._commands(knots)]

    def _better(self, value: Value, best: Design, knots: Array) -> Design:
        """The better of `best` and the motion of `knots`, which is evaluated with its own whitening."""
        found = self._design(value, knots)
        return found if found.value > best.value else best

    def _design(self, value: Value, knots: Array) -> Design:
        commands = self.commands(knots)
        planned = self.motion(commands)
        return Design(planned, commands, knots, value(self.problem(planned)))

    def _first(self, value: Value, random: np.random.Generator, starts: Sequence[Array]) -> Design:
        """The best of random motions of different smoothness and of `starts`."""
        config = self.effort.config
        kinds = dict.fromkeys((min(4, config.knots), (4 + config.knots) // 2, config.knots))
        knots = np.concatenate([self._random_knots(kind, config.candidates, random) for kind in kinds])
        commands = self._commands(knots)
        scored = self._score(value, self.motion(commands[0]))(commands)
        found = [knots[int(np.argmax(scored.scores))], *starts]
        return max((self._design(value, candidate) for candidate in found), key=lambda design: design.value)

    def _score(self, value: Value, reference: Motion) -> MotionScore:
        like = self.problem(reference) if self._alike else None
        return MotionScore(self.bench, self.shape, self.limits, value, like)

    @property
    def _alike(self) -> bool:
        """Whether the rows' noise covariance is nearly the same for all motions, so that one whitening serves all."""
        return not self.scene.physics.contacts and not self.scene.wrench_sensors
