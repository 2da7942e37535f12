"""Scores of plans after their reduction by a force guard."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.design.force_belief import condensed
from drake_cafim.design.force_guard import GuardConfig, guarded_commands
from drake_cafim.design.planner import Scored
from drake_cafim.design.situation import Situation
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class GuardedScore:
    """`score` of each plan after the guard has reduced its commands, one after the other.

    Without this, a plan may rely on commands that the guard reduces, and be less informative than a more cautious one.
    The guard's present belief (`Situation.forces`) is condensed to its moments, and the reduction is computed more
    coarsely than by the guard itself.
    """

    model: PlanningModel
    score: Callable[[Situation, Array], Scored]
    limit: float  # N
    config: GuardConfig = field(default_factory=lambda: GuardConfig(shares=4, instants=1))

    def __call__(self, situation: Situation, commands: Array) -> Scored:
        """Scores of commands (N, H, nu)."""
        return self.score(situation, self.let_through(situation, commands))

    def let_through(self, situation: Situation, commands: Array) -> Array:
        """The commands (N, H, nu) as the guard is expected to reduce them."""
        assert situation.forces is not None, "the policy was made for a guard, and the situation knows of none"
        belief = condensed(self.model, situation.forces)
        states = np.repeat(situation.robot_state[np.newaxis], len(commands), axis=0)
        passed = np.empty_like(commands)
        for step in range(commands.shape[1]):
            passed[:, step] = guarded_commands(self.model, belief, states, commands[:, step], self.limit, self.config)
            states = self.model.motion(states, passed[:, step : step + 1])[:, -1]
        return passed
