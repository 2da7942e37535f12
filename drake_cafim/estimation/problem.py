"""The CA-MAP problem: a planning model, the prior, the data, and the negative log posterior of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.errors import InputError
from drake_cafim.information import fisher_information
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.finite_difference import predict
from drake_cafim.sensitivity.model import PlanningModel, Rollout, Start
from drake_cafim.sensitivity.tangent import FastRollout
from drake_cafim.typing import Array

LARGEST = 2**18
"""Measurements predicted at once."""


@dataclass(frozen=True)
class Data:
    """One experiment: robot states (T+1, 2 nu) at the ends of the periods, measurements (T, ny) after each.

    Missing measurements are NaN and have no influence.
    """

    robot_states: Array
    measurements: Array

    def __post_init__(self) -> None:
        if len(self.robot_states) != len(self.measurements) + 1:
            raise InputError(
                f"experiment data: {len(self.robot_states)} robot states and {len(self.measurements)} measurements, "
                f"expected one robot state more than measurements"
            )


@dataclass(frozen=True)
class Group:
    """Experiments of equal length, stacked: motion (E, T·substeps + 1, nr), measurements (E, T, ny)."""

    motion: Array
    measurements: Array
    places: tuple[int, ...]  # indices of its experiments among all


@dataclass(frozen=True)
class MapProblem:
    """ℓ(θ) = ½ Σ |(y − ŷ(θ)) / σ|² + ½ (θ − θ₀)ᵀ Σ₀⁻¹ (θ − θ₀), the negative log posterior up to a constant.

    It holds all data so far and the original prior: the paper's Def. 4 with the trajectory τ eliminated by rolling the
    model out along the measured motion of the robot.
    """

    model: PlanningModel
    evaluator: Evaluator
    prior: Belief
    groups: tuple[Group, ...]

    @property
    def experiments(self) -> int:
        """The number of experiments E."""
        return sum(len(group.places) for group in self.groups)

    def cost(self, theta: Array) -> float:
        """ℓ(θ), computed without derivatives unless the model has a fast rollout of its own."""
        total = self._prior_cost(theta)
        for group in self.groups:
            start = self._start(group, theta)
            if isinstance(self.model, FastRollout):
                rollout = self.model.rollout(group.motion, theta, start)
            else:
                rollout = predict(self.model, group.motion, theta, start.state)
            total += 0.5 * float((self._residual(group, rollout) ** 2).sum())
        return total

    def costs(self, points: Array) -> Array:
        """ℓ (m,) at the points θ (m, n); all at once where the touched object has no state."""
        if self.model.state_size or not self.groups:
            return np.array([self.cost(point) for point in points])
        samples = sum(group.measurements.size for group in self.groups)
        parts = np.array_split(points, int(np.ceil(len(points) * samples / LARGEST)))
        return np.concatenate([self._stateless_costs(part) for part in parts])

    def _stateless_costs(self, points: Array) -> Array:
        away = points - self.prior.mean
        total = 0.5 * np.einsum("mi,ij,mj->m", away, self.prior.information, away)
        for group in self.groups:
            rollout = predict(self.model, group.motion, points[:, np.newaxis, np.newaxis], np.zeros(0))
            total = total + 0.5 * (self._residual(group, rollout) ** 2).sum(axis=(1, 2, 3))
        return np.asarray(total)

    def cost_and_gradient(self, theta: Array) -> tuple[float, Array]:
        """ℓ(θ) and dℓ/dθ = −Σ Gᵀ (y − ŷ)/σ² + Σ₀⁻¹ (θ − θ₀), (n,), with the evaluator's sensitivities G."""
        total, gradient = self._prior_cost(theta), self.prior.information @ (theta - self.prior.mean)
        for group in self.groups:
            rollout = self._rollout(group, theta)
            residual = self._residual(group, rollout)
            total += 0.5 * float((residual**2).sum())
            whitened = rollout.sensitivities / self.model.noise_std[:, np.newaxis]
            gradient = gradient - np.einsum("bty,btyn->n", residual, whitened)
        return total, np.asarray(gradient)

    def fisher(self, theta: Array) -> Array:
        """Fisher information (E, n, n) of each experiment at θ, without the prior."""
        result = np.zeros((self.experiments, len(theta), len(theta)))
        for group in self.groups:
            slopes = self._rollout(group, theta).sensitivities
            slopes = np.where(np.isfinite(group.measurements)[..., np.newaxis], slopes, 0.0)
            result[list(group.places)] = fisher_information(slopes, self.model.noise_std)
        return result

    def predictions(self, theta: Array) -> list[Array]:
        """Predicted measurements (T, ny) of each experiment."""
        result: list[Array] = [np.zeros(0)] * self.experiments
        for group in self.groups:
            for place, reading in zip(group.places, self._rollout(group, theta).measurements, strict=True):
                result[place] = reading
        return result

    def _prior_cost(self, theta: Array) -> float:
        away = theta - self.prior.mean
        return 0.5 * float(away @ self.prior.information @ away)

    def _start(self, group: Group, theta: Array) -> Start:
        starts = [self.model.start(motion[0], theta) for motion in group.motion]
        return Start(np.stack([s.state for s in starts]), np.stack([s.sensitivity for s in starts]))

    def _rollout(self, group: Group, theta: Array) -> Rollout:
        return self.evaluator(group.motion, theta, self._start(group, theta))

    def _residual(self, group: Group, rollout: Rollout) -> Array:
        """(y − ŷ)/σ (E, T, ny), zero where nothing was measured."""
        residual = (group.measurements - rollout.measurements) / self.model.noise_std
        return np.where(np.isfinite(residual), residual, 0.0)


def make_problem(
    model: PlanningModel, evaluator: Evaluator, data: Sequence[Data], prior: Belief | None = None
) -> MapProblem:
    """The problem of `data` with `prior`, by default the model's."""
    by_length: dict[int, list[int]] = {}
    for place, experiment in enumerate(data):
        by_length.setdefault(len(experiment.measurements), []).append(place)
    groups = []
    for places in by_length.values():
        states = np.stack([data[place].robot_states for place in places])
        measured = np.stack([data[place].measurements for place in places])
        groups.append(Group(model.measured_motion(states), measured, tuple(places)))
    prior = Belief.prior(model.parameters) if prior is None else prior
    return MapProblem(model, evaluator, prior, tuple(groups))
