"""A score averaged over the belief instead of evaluated at its mean θ."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.design.sigma_points import sigma_points
from drake_cafim.design.situation import Situation
from drake_cafim.errors import InputError
from drake_cafim.sensitivity.model import PlanningModel, Start
from drake_cafim.typing import Array

MOST_SAMPLES = 1000
"""Largest number of points of the belief over which a plan's score is averaged."""


@dataclass(frozen=True)
class BeliefAveragedScore:
    """E[ψ(F(θ)) − J(θ)] over `samples` sigma points of the present belief, inside the parameters' bounds.

    The initial state of the touched object is shifted with θ to first order, by its sensitivity.
    """

    model: PlanningModel
    score: Callable[[Situation, Array], Scored]
    samples: int

    def __post_init__(self) -> None:
        least = len(self.model.parameters.free) + 1
        if not least <= self.samples <= MOST_SAMPLES:
            raise InputError(
                f"--belief-samples {self.samples}: expected 1 (the mode alone), or from {least}, "
                f"one more than the unknowns, to {MOST_SAMPLES}"
            )
        if not np.isfinite(self.model.parameters.std).all():
            raise InputError("--belief-samples: a parameter has no prior, expected a finite std of each")

    def __call__(self, situation: Situation, commands: Array) -> Scored:
        """Mean scores of commands (N, H, nu), and the mean of their Fisher information."""
        points = sigma_points(situation.theta, situation.covariance, self.samples)
        scored = [self.score(_at(situation, self.model.parameters.clip(theta)), commands) for theta in points]
        return Scored(
            np.asarray(np.mean([sample.scores for sample in scored], axis=0)),
            np.asarray(np.mean([sample.fisher for sample in scored], axis=0)),
        )


def _at(situation: Situation, theta: Array) -> Situation:
    """The situation with θ as the estimate, and the touched object's state shifted accordingly."""
    touched = situation.touched
    moved = touched.state + touched.sensitivity @ (theta - situation.theta)
    return replace(situation, theta=theta, touched=Start(moved, touched.sensitivity))
