"""A policy that first brings the robot to what earlier experiments did not find, and then plans as before.

A planner that looks half a second ahead touches what is near again and again; what is farther away stays unknown.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from drake_cafim.design.planner import PlannerConfig
from drake_cafim.design.policies import Policy
from drake_cafim.design.situation import Decision, Situation
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@runtime_checkable
class Searchable(Protocol):
    """A planning model that knows where to feel for a parameter."""

    def approach(self, name: str, robot_state: Array, theta: Array, std: Array) -> Array | None:
        """The velocity (nu,) m/s towards where parameter `name` is felt; None once that is near.

        From `robot_state` (2 nu,), with the belief's mean `theta` (n,) and `std` (n,).
        """
        ...


@dataclass(frozen=True)
class SearchingPolicy:
    """`policy`, but while an experiment searches, the model's approach to the first parameter that is not found."""

    model: PlanningModel
    policy: Policy

    @property
    def config(self) -> PlannerConfig:
        return self.policy.config

    @property
    def shifts(self) -> bool:
        return self.policy.shifts

    def __call__(self, situation: Situation, random: np.random.Generator) -> Decision:
        for name in situation.unfound:
            assert isinstance(self.model, Searchable)
            std = np.sqrt(np.diag(situation.covariance))
            command = self.model.approach(name, situation.robot_state, situation.theta, std)
            if command is None:
                break
            plan = np.repeat(command[np.newaxis], self.config.horizon, axis=0)
            nothing = np.zeros_like(situation.information)
            return Decision(command, plan, np.zeros_like(situation.knots), nothing, plan[np.newaxis])
        return self.policy(situation, random)
