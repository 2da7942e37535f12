"""Policies with a common interface, from a situation to a command: planning ones and the baselines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, get_args

import numpy as np

from drake_cafim.design.attainable import attainable
from drake_cafim.design.averaging import BeliefAveragedScore
from drake_cafim.design.guarded_score import GuardedScore
from drake_cafim.design.iterative import CrossEntropy, GradientAscent, PathIntegral
from drake_cafim.design.law_scores import LawAveragedScore
from drake_cafim.design.planner import (
    PLANNERS,
    Planner,
    PlannerConfig,
    PlannerName,
    Scored,
    candidate_commands,
)
from drake_cafim.design.predictive_sampling import PredictiveSampling
from drake_cafim.design.scores import InformationScore, OneStepScore
from drake_cafim.design.situation import Decision, Situation
from drake_cafim.errors import InputError
from drake_cafim.information import Criterion
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.finite_difference import FiniteDifferenceEvaluator
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.typing import Array

PolicyName: TypeAlias = Literal["contact-aware", "finite-difference", "asid", "random", "scripted", "hold"]
POLICIES: tuple[str, ...] = get_args(PolicyName)


Scoring: TypeAlias = Callable[[Situation, Array], Scored]
"""From a situation and commands (N, H, nu) to the commands' scores."""


class Policy(Protocol):
    """Decides one command; its only state is the situation's knots."""

    @property
    def config(self) -> PlannerConfig:
        """The planner's configuration, which gives the sizes of its plans."""
        ...

    @property
    def shifts(self) -> bool:
        """Whether the knots are shifted by a step between decisions, as a warm start of the next plan."""
        ...

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        """The command for the coming period."""
        ...


@dataclass(frozen=True)
class PlanningPolicy:
    """Plans by `planner` for `score` at every step, and executes the plan's first command."""

    model: PlanningModel
    planner: Planner
    score: Scoring

    @property
    def config(self) -> PlannerConfig:
        return self.planner.config

    @property
    def shifts(self) -> bool:
        return True

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        plan = self.planner(
            situation.knots,
            lambda commands: self.score(situation, commands),
            self.model.velocity_bounds,
            random,
        )
        command = attainable(self.model, situation.robot_state, plan.commands[0])
        return Decision(command, plan.commands, plan.knots, plan.fisher, plan.candidates)


@dataclass(frozen=True)
class RandomPolicy:
    """Executes splines with uniform random knots, a new spline at the end of each."""

    model: PlanningModel
    config: PlannerConfig
    shifts: bool = False

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        bounds = self.model.velocity_bounds
        knots = situation.knots
        if situation.step % self.config.horizon == 0:
            knots = random.uniform(*bounds, size=(self.config.knots, len(bounds[0])))
        spline = candidate_commands(knots[np.newaxis], self.config.horizon, bounds)[0]
        done = situation.step % self.config.horizon
        plan = np.concatenate([spline[done:], np.repeat(spline[-1:], done, axis=0)])
        return _decide(self.model, situation, plan, knots)


@dataclass(frozen=True)
class ScriptedPolicy:
    """Executes the model's script, or `script` (time, robot state, θ) → command."""

    model: PlanningModel
    config: PlannerConfig
    script: Callable[[float, Array, Array], Array] | None = None
    shifts: bool = False

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        script = self.model.script if self.script is None else self.script
        command = script(situation.time, situation.robot_state, situation.theta)
        plan = np.repeat(np.clip(command, *self.model.velocity_bounds)[np.newaxis], self.config.horizon, axis=0)
        return _decide(self.model, situation, plan, situation.knots)


@dataclass(frozen=True)
class HoldPolicy:
    """Commands zero velocity."""

    model: PlanningModel
    config: PlannerConfig
    shifts: bool = False

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        plan = np.zeros((self.config.horizon, len(self.model.velocity_bounds[0])))
        return _decide(self.model, situation, plan, situation.knots)


def _decide(model: PlanningModel, situation: Situation, plan: Array, knots: Array) -> Decision:
    command = attainable(model, situation.robot_state, plan[0])
    nothing = np.zeros_like(situation.information)
    return Decision(command, plan, knots, nothing, plan[np.newaxis])


def make_planner(name: PlannerName, config: PlannerConfig | None = None) -> Planner:
    """The planner called `name`; the `InputError` for an unknown name lists the valid names."""
    config = PlannerConfig() if config is None else config
    if name == "predictive-sampling":
        return PredictiveSampling(config)
    if name == "cem":
        return CrossEntropy(config)
    if name == "mppi":
        return PathIntegral(config)
    if name == "gradient":
        return GradientAscent(config)
    raise InputError(f"--planner {name!r}: expected one of {', '.join(PLANNERS)}")


def make_policy(
    name: PolicyName,
    model: PlanningModel,
    *,
    planner: PlannerName = "predictive-sampling",
    criterion: Criterion = "logdet",
    evaluate: Callable[[PlanningModel], Evaluator] = TangentEvaluator,
    config: PlannerConfig | None = None,
    belief_samples: int = 1,
    force_limit: float | None = None,
    laws: Mapping[str, PlanningModel] | None = None,
) -> Policy:
    """The policy called `name`; the `InputError` for an unknown name lists the valid names.

    `evaluate` makes the evaluator of contact-aware for a model; finite-difference always differences whole
    trajectories. The planning policies' scores are averaged over `belief_samples` points of the belief; 1 is its mean
    alone. With a `force_limit` N they account for the force guard between the controller and the robot. With several
    `laws`, planning models by name, `model` the first of them, contact-aware and finite-difference plan for all.
    """
    config = PlannerConfig() if config is None else config
    if name in ("contact-aware", "finite-difference"):
        chosen = evaluate if name == "contact-aware" else FiniteDifferenceEvaluator

        def informed(of: PlanningModel) -> InformationScore:
            return InformationScore(of, chosen(of), criterion)

        plain: Scoring = informed(model)
        if laws is not None and len(laws) > 1:
            plain = LawAveragedScore({law: informed(of) for law, of in laws.items()})
        score = _scoring(plain, model, belief_samples, force_limit)
        return PlanningPolicy(model, make_planner(planner, config), score)
    if name == "asid":
        score = _scoring(OneStepScore(model), model, belief_samples, force_limit)
        return PlanningPolicy(model, make_planner(planner, config), score)
    if name == "random":
        return RandomPolicy(model, config)
    if name == "scripted":
        return ScriptedPolicy(model, config)
    if name == "hold":
        return HoldPolicy(model, config)
    raise InputError(f"--policy {name!r}: expected one of {', '.join(POLICIES)}")


def _scoring(score: Scoring, model: PlanningModel, samples: int, force_limit: float | None) -> Scoring:
    """`score` averaged over the belief and evaluated for guarded commands, where these are set."""
    averaged = score if samples == 1 else BeliefAveragedScore(model, score, samples)
    return averaged if force_limit is None else GuardedScore(model, averaged, force_limit)
