"""What the contact force may be, learned from measured, noisy forces by a filter that does not believe its model.

Under each of a few hypotheses θ_k about the parameters, with weights w_k, the true force is s_k λ̂(θ_k), its gain
s_k ~ N(m_k, v_k), at first N(1, `gain_std`²). A measured force corrects the gains, and the weights by what each
hypothesis had expected of it: a face that should have been felt by now and was not loses its weight.
"""

from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.design.averaging import sigma_points
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class FilterConfig:
    """How little the model is believed."""

    points: int = 32  # hypotheses
    gain_std: float = 0.4  # of the true force over the predicted one, before any was felt
    drift: float = 0.5  # 1/√s, std of the gain's random walk after a second
    fewest: float = 0.5  # part of the hypotheses; with weight on fewer, they are placed anew


@dataclass(frozen=True)
class ForceBelief:
    """Hypotheses `theta` (m, n), their `log_weight` (m,), and the gains' `mean` and `variance`, (m,) each."""

    theta: Array
    log_weight: Array
    mean: Array
    variance: Array

    @property
    def weight(self) -> Array:
        """Probabilities (m,) of the hypotheses."""
        likely = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(likely / likely.sum())

    def vector(self) -> Array:
        """All of it, (m (n + 3),)."""
        return np.concatenate([self.theta.ravel(), self.log_weight, self.mean, self.variance])

    @classmethod
    def from_vector(cls, vector: Array, count: int) -> "ForceBelief":
        """The inverse of `vector`, for `count` hypotheses."""
        theta, rest = np.split(vector, [len(vector) - 3 * count])
        log_weight, mean, variance = np.split(rest, 3)
        return cls(theta.reshape(count, -1), log_weight, mean, variance)


def first_force_belief(model: PlanningModel, belief: Belief, config: FilterConfig) -> ForceBelief:
    """Before any force was felt: equally likely hypotheses, spread as the belief is, inside the model's bounds."""
    theta = _clip(model, sigma_points(belief.mean, belief.covariance, config.points))
    ones = np.ones(config.points)
    return ForceBelief(theta, 0.0 * ones, ones, config.gain_std**2 * ones)


def predicted_forces(model: PlanningModel, robot_states: Array, theta: Array) -> Array:
    """λ̂ (m, ..., nλ) N under `theta` (m, n), at robot states (..., 2 nu), on what does not move."""
    state = np.zeros((*robot_states.shape[:-1], 0))
    return np.stack([model.contact(state, robot_states, point) for point in theta])


def learn(
    model: PlanningModel, before: ForceBelief, robot_state: Array, measured: Array, config: FilterConfig
) -> ForceBelief:
    """The belief a period later: a random walk of the gains, corrected by `measured` (nλ,) N at `robot_state`.

    Where no force is predicted the gain is less certain by a period; never less than at first.
    """
    variance = np.minimum(before.variance + config.drift**2 * model.period, config.gain_std**2)
    whitened = predicted_forces(model, robot_state, before.theta) / model.noise_std
    innovation = measured / model.noise_std - before.mean[:, np.newaxis] * whitened
    after = 1.0 / (1.0 / variance + (whitened**2).sum(axis=-1))
    along = (whitened * innovation).sum(axis=-1)
    # log N(innovation; 0, I + variance whitened whitenedᵀ), by Sherman and Morrison
    surprise = (innovation**2).sum(axis=-1) - after * along**2 + np.log(variance / after)
    learned = ForceBelief(before.theta, before.log_weight - 0.5 * surprise, before.mean + after * along, after)
    few = 1.0 / (learned.weight**2).sum() < config.fewest * config.points
    return _placed_anew(model, learned) if few else learned


def _placed_anew(model: PlanningModel, old: ForceBelief) -> ForceBelief:
    """As many equally likely hypotheses, θ and gain together of the same mean, their covariance no finer than before.

    Points that lay `spacing` apart, in units of their spread, tell no more than that.
    """
    points = np.column_stack([old.theta, old.mean])
    count, size = points.shape
    spacing = count ** (-1.0 / size)
    centre = old.weight @ points
    covariance = (old.weight[:, np.newaxis] * (points - centre)).T @ (points - centre)
    covariance = covariance + spacing**2 * np.cov(points.T, bias=True)
    placed = sigma_points(centre, covariance, count)
    same = replace(old, log_weight=np.zeros(count), variance=np.full(count, old.weight @ old.variance))
    return replace(same, theta=_clip(model, placed[:, :-1]), mean=placed[:, -1])


def _clip(model: PlanningModel, points: Array) -> Array:
    return np.stack([model.parameters.clip(point) for point in points])
