"""Scores of candidate motions: information about θ minus cost."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.design.situation import Hypothesis, Situation
from drake_cafim.information import Criterion, criterion, fisher_information, without_nuisance
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.finite_difference import predict
from drake_cafim.sensitivity.model import PlanningModel, Rollout
from drake_cafim.typing import Array


@dataclass(frozen=True)
class InformationScore:
    """ψ(F) − J (paper, Eq. 10), F by the sensitivities of `evaluator` along each candidate, at the estimate θ."""

    model: PlanningModel
    evaluator: Evaluator
    criterion: Criterion = "logdet"

    def __call__(self, situation: Situation, commands: Array) -> Scored:
        """Scores of commands (N, H, nu)."""
        motion = self.model.motion(situation.robot_state, commands)
        return self.of_rollout(self.evaluator(motion, situation.theta, situation.touched), situation)

    def of_rollout(self, rollout: Rollout, situation: Situation | Hypothesis) -> Scored:
        """Scores of the rollout's candidates; what is learned of nuisance parameters does not count."""
        fisher = fisher_information(rollout.sensitivities, self.model.noise_std)
        counted = without_nuisance(fisher, situation.information, self.model.parameters.sought)
        gain = criterion(self.criterion, *counted)
        return Scored(gain - self.model.cost(rollout, situation.theta), fisher)


@dataclass(frozen=True)
class OneStepScore:
    """The reward of ASID (Memmel et al.): tr(GᵀG) of one step, G_i = [o(θ + δ e_i) − o(θ − δ e_i)] / 2δ.

    o is the state after one step from the same full state, without noise covariance, propagation in time or forces.
    Clipped to [0, 1000] at each step, as by its authors, and summed over the horizon.
    """

    model: PlanningModel
    relative_step: float = 1e-2
    greatest: float = 1000.0

    def __call__(self, situation: Situation, commands: Array) -> Scored:
        """Scores of commands (N, H, nu)."""
        model, theta = self.model, situation.theta
        motion = model.motion(situation.robot_state, commands)
        rollout = predict(model, motion, theta, situation.touched.state)
        reward = self._reward(rollout.states, motion, theta)
        size = len(theta)
        nothing = np.zeros((len(commands), size, size))
        return Scored(reward - model.cost(rollout, theta), nothing)

    def _reward(self, states: Array, motion: Array, theta: Array) -> Array:
        model, stride = self.model, self.model.substeps
        total = np.zeros(states.shape[:2])[:, 1:]
        for index, size in enumerate(np.maximum(np.abs(theta), 1e-9) * self.relative_step):
            shift = np.zeros_like(theta)
            shift[index] = size
            ends = []
            for sign in (1.0, -1.0):
                x = states[:, :-1]
                for substep in range(stride):
                    before, after = motion[:, substep:-1:stride], motion[:, substep + 1 :: stride]
                    force = model.contact(x, before, theta + sign * shift)
                    x = model.step(x, before, after, force, theta + sign * shift)
                ends.append(x)
            total = total + (((ends[0] - ends[1]) / (2.0 * size)) ** 2).sum(axis=-1)
        return np.asarray(np.clip(total, 0.0, self.greatest).sum(axis=-1))
