"""The class `Task`: a planning model, the true parameters, the robot's start, and the number of experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.parameters import Parameters
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Task:
    """One of the paper's scenarios, or your own.

    `robot_start` is (2 nu,): position m and velocity m/s in the planner's coordinates. An experiment lasts
    `periods` planning steps; an estimate is made every `estimate_every` of them, or at the end only (0).
    """

    name: str
    model: PlanningModel
    truth: Mapping[str, float]
    robot_start: Array
    periods: int
    experiments: int
    estimate_every: int = 0

    @property
    def theta(self) -> Array:
        """The true parameters, (n,)."""
        return self.model.parameters.vector(self.truth)

    def with_prior_mean(self, scale: float | Array) -> "Task":
        """The task with the prior's mean at `scale` times the truth: one factor, or one for each parameter."""
        means = np.asarray(scale) * self.theta
        items = [
            replace(parameter, mean=float(np.clip(mean, parameter.lower, parameter.upper)))
            for parameter, mean in zip(self.model.parameters.free, means, strict=True)
        ]
        # every packaged model is a dataclass with a field `parameters`
        return replace(self, model=replace(self.model, parameters=Parameters.of(items)))  # type: ignore[type-var]
