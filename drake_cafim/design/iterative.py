"""Planners that improve a plan in several rounds: the cross-entropy method, MPPI, and gradient ascent.

They need about as many rollouts per planning step as predictive sampling, `config.candidates`; `rollouts` gives the
exact number.
"""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.design.planner import (
    Plan,
    PlannerConfig,
    Score,
    Scored,
    around,
    best_index,
    candidate_commands,
)
from drake_cafim.typing import Array


@dataclass
class _Seen:
    """All candidates of one planning step; the best of them becomes the plan."""

    knots: list[Array]
    commands: list[Array]
    scored: list[Scored]

    def plan(self, random: np.random.Generator) -> Plan:
        knots, commands = np.concatenate(self.knots), np.concatenate(self.commands)
        scores = np.concatenate([scored.scores for scored in self.scored])
        fisher = np.concatenate([scored.fisher for scored in self.scored])
        best = best_index(scores, random)
        return Plan(knots[best], commands[best], fisher[best], commands, scores)


class _Rounds:
    """Scores candidates round by round and stores them."""

    def __init__(self, config: PlannerConfig, score: Score, bounds: tuple[Array, Array]) -> None:
        self.config, self.score, self.bounds = config, score, bounds
        self.seen = _Seen([], [], [])

    def __call__(self, knots: Array) -> Array:
        commands = candidate_commands(knots, self.config.horizon, self.bounds)
        scored = self.score(commands)
        self.seen.knots.append(knots)
        self.seen.commands.append(commands)
        self.seen.scored.append(scored)
        return scored.scores


@dataclass(frozen=True)
class CrossEntropy:
    """CEM: each round refits mean and spread to its elites; the best candidate of all rounds is the plan."""

    config: PlannerConfig = field(default_factory=PlannerConfig)

    def rollouts(self, numbers: int) -> int:
        """Number of rollouts: rounds of equal size, so at most `config.candidates`."""
        return self.config.iterations * (self.config.candidates // self.config.iterations)

    def __call__(self, nominal: Array, score: Score, bounds: tuple[Array, Array], random: np.random.Generator) -> Plan:
        rounds = _Rounds(self.config, score, bounds)
        count = self.config.candidates // self.config.iterations
        kept = max(2, round(self.config.elites * count))
        mean, std = nominal, np.full(nominal.shape, self.config.knot_std)
        for _ in range(self.config.iterations):
            knots = around(mean, count, std, bounds, random)
            scores = rounds(knots)
            # ties are broken at random: on a plateau the nominal, which is first, would otherwise always be kept
            elites = knots[np.lexsort((random.random(count), scores))[-kept:]]
            mean, std = elites.mean(axis=0), elites.std(axis=0) + 0.05 * self.config.knot_std
        return rounds.seen.plan(random)


@dataclass(frozen=True)
class PathIntegral:
    """MPPI: each round moves the nominal to the average of its candidates, weighted by exp(score / temperature).

    The last rollout is that of the final average; the best candidate of all rounds is the plan.
    """

    config: PlannerConfig = field(default_factory=PlannerConfig)

    def rollouts(self, numbers: int) -> int:
        """Number of rollouts: rounds of equal size and the final average, so at most `config.candidates`."""
        return self.config.iterations * ((self.config.candidates - 1) // self.config.iterations) + 1

    def __call__(self, nominal: Array, score: Score, bounds: tuple[Array, Array], random: np.random.Generator) -> Plan:
        rounds = _Rounds(self.config, score, bounds)
        count = (self.config.candidates - 1) // self.config.iterations
        mean = nominal
        for _ in range(self.config.iterations):
            knots = around(mean, count, self.config.knot_std, bounds, random)
            scores = rounds(knots)
            spread = scores.std()
            scaled = (scores - scores.max()) / (self.config.temperature * spread) if spread > 0 else 0.0 * scores
            weights = np.exp(scaled) / np.exp(scaled).sum()
            mean = np.einsum("n,nkj->kj", weights, knots)
        rounds(mean[np.newaxis])
        return rounds.seen.plan(random)


@dataclass(frozen=True)
class GradientAscent:
    """Ascent of the score in the knots, from the nominal and from random splines.

    The score uses analytic sensitivities; its gradient in the knots is computed by forward differences, one rollout
    per knot. The rest of the budget goes to random starts (first) and to steps along the gradient (last).
    """

    config: PlannerConfig = field(default_factory=PlannerConfig)
    difference: float = 1e-4  # m/s

    def rollouts(self, numbers: int) -> int:
        """Number of rollouts: one per knot value (`numbers`) for the gradient, at least four for starts and steps."""
        return numbers + max(4, self.config.candidates - numbers)

    def __call__(self, nominal: Array, score: Score, bounds: tuple[Array, Array], random: np.random.Generator) -> Plan:
        rounds = _Rounds(self.config, score, bounds)
        size = nominal.size
        spare = max(4, self.config.candidates - size)
        starts = around(nominal, spare // 2, self.config.knot_std, bounds, random)
        scores = rounds(starts)
        start = starts[best_index(scores, random)]
        moved = start[np.newaxis] + self.difference * np.eye(size).reshape(size, *nominal.shape)
        probes = candidate_commands(moved, self.config.horizon, bounds)
        slope = ((score(probes).scores - scores.max()) / self.difference).reshape(nominal.shape)
        length = np.abs(slope).max()
        if length > 0:
            steps = self.config.gradient_step * 0.3 ** np.arange(spare - spare // 2)
            rounds(np.clip(start + steps[:, np.newaxis, np.newaxis] * slope / length, *bounds))
        return rounds.seen.plan(random)
