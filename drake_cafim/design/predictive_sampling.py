"""Predictive sampling: of a few random splines about the last plan, the best (Howell et al.; the paper's planner)."""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.design.planner import Plan, PlannerConfig, Score, around, best_index, candidate_commands
from drake_cafim.typing import Array


@dataclass(frozen=True)
class PredictiveSampling:
    """Samples `config.candidates` splines at once; candidate 0 is the nominal."""

    config: PlannerConfig = field(default_factory=PlannerConfig)

    def rollouts(self, numbers: int) -> int:
        """`config.candidates`."""
        return self.config.candidates

    def __call__(self, nominal: Array, score: Score, bounds: tuple[Array, Array], random: np.random.Generator) -> Plan:
        knots = around(nominal, self.config.candidates, self.config.knot_std, bounds, random)
        commands = candidate_commands(knots, self.config.horizon, bounds)
        scored = score(commands)
        best = best_index(scored.scores, random)
        return Plan(knots[best], commands[best], scored.fisher[best], commands, scored.scores)
