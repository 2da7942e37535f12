"""A belief over the contact force, updated from measured forces by a filter that allows for model error.

Under each of m hypotheses θ_k about the parameters, with weights w_k, the true force is λ̂ (a_k + b_k |λ̂|/L), with λ̂
the force predicted with θ_k and L the force limit: larger or smaller than predicted by a factor, and growing faster or
slower with penetration, as Drake's hydroelastic contact does. The gains (a_k, b_k) are Gaussian, initially with mean
(1, 0). A measured force updates the gains by a Kalman filter, and the weights by the innovation's likelihood: a
hypothesis that predicts a contact where none is measured loses weight.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.design.sigma_points import sigma_points
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array

GAINS = 2
"""Number of gains of each hypothesis: a and b."""


@dataclass(frozen=True)
class FilterConfig:
    """The assumed model error: prior std and drift of the gains, and the number of hypotheses."""

    points: int = 48  # hypotheses
    # prior std of a + b, the gain at the limit, and of b, where b = 1 is a force that grows with the square of the
    # predicted one. They are independent; otherwise small forces far below the predicted ones would imply small forces
    # at the limit. They are large: near the limit, hydroelastic contact is 2.3 times as strong as predicted by a model
    # whose stiffness is 30 % too low
    gain_std: tuple[float, float] = (0.5, 0.6)
    drift: float = 0.05  # 1/√s, std of a gain's random walk after a second
    fewest: float = 0.15  # least effective fraction of the hypotheses; below it they are resampled


@dataclass(frozen=True)
class ForceBelief:
    """Hypotheses `theta` (m, n), their `log_weight` (m,), the gains' `mean` (m, 2) and `covariance` (m, 2, 2)."""

    theta: Array
    log_weight: Array
    mean: Array
    covariance: Array

    @cached_property
    def weight(self) -> Array:
        """Probabilities (m,) of the hypotheses."""
        likely = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(likely / likely.sum())

    def vector(self) -> Array:
        """θ, log weights, means and covariances as one vector (m (n + 7),)."""
        return np.concatenate([self.theta.ravel(), self.log_weight, self.mean.ravel(), self.covariance.ravel()])

    @staticmethod
    def vector_size(count: int, parameters: int) -> int:
        """The length of `vector` for `count` hypotheses about n = `parameters` parameters."""
        return count * (parameters + 1 + GAINS + GAINS**2)

    @classmethod
    def from_vector(cls, vector: Array, count: int) -> "ForceBelief":
        """The inverse of `vector`, for `count` hypotheses."""
        ends = np.cumsum([count * GAINS**2, count * GAINS, count])
        theta, log_weight, mean, covariance = np.split(vector, len(vector) - ends[::-1])
        return cls(
            theta.reshape(count, -1), log_weight, mean.reshape(count, -1), covariance.reshape(count, GAINS, GAINS)
        )


def first_force_belief(model: PlanningModel, belief: Belief, config: FilterConfig) -> ForceBelief:
    """The belief before any measurement: equally likely hypotheses with the belief's moments, clipped to the bounds."""
    theta = model.parameters.clip(sigma_points(belief.mean, belief.covariance, config.points))
    shape = (config.points, GAINS)
    first = np.broadcast_to(_first_covariance(config), (*shape, GAINS))
    return ForceBelief(theta, np.zeros(config.points), np.broadcast_to([1.0, 0.0], shape), first)


def _first_covariance(config: FilterConfig) -> Array:
    """The prior covariance (2, 2) of (a, b), for which a + b and b are independent."""
    gains = np.array([[1.0, -1.0], [0.0, 1.0]]) * config.gain_std
    return np.asarray(gains @ gains.T)


def predicted_forces(model: PlanningModel, robot_states: Array, theta: Array) -> Array:
    """λ̂ (m, ..., nλ) N under `theta` (m, n), at robot states (..., 2 nu), for a touched object without a state.

    Vectorised: the model's `contact` takes θ (..., n) with leading axes that broadcast with the motion's.
    """
    state = np.zeros((*robot_states.shape[:-1], 0))
    return model.contact(state, robot_states, theta.reshape(len(theta), *[1] * (robot_states.ndim - 1), -1))


def sizes(vectors: Array) -> Array:
    """The lengths (...,) of `vectors` (..., k); `numpy.linalg.norm` takes three times as long of few."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def magnitude(belief: ForceBelief, forces: Array, limit: float) -> tuple[Array, Array]:
    """Mean and variance (m, ...) of the true force along the predicted `forces` (m, ..., nλ), N and N²."""
    size = sizes(forces)
    square = size**2 / limit
    each = (slice(None), *[np.newaxis] * (size.ndim - 1))
    (a, b), covariance = (belief.mean[:, k][each] for k in range(GAINS)), belief.covariance
    var_a, cov, var_b = (covariance[:, i, j][each] for i, j in ((0, 0), (0, 1), (1, 1)))
    return a * size + b * square, var_a * size**2 + 2.0 * cov * size * square + var_b * square**2


def learn(
    model: PlanningModel,
    before: ForceBelief,
    robot_state: Array,
    measured: Array,
    limit: float,
    config: FilterConfig,
) -> ForceBelief:
    """The belief a period later: random walk of the gains, then an update by `measured` (nλ,) N at `robot_state`."""
    forces = predicted_forces(model, robot_state, before.theta)
    size = np.linalg.norm(forces, axis=-1, keepdims=True)
    slope = np.stack([forces, forces * size / limit], axis=-1) / model.noise_std[:, np.newaxis]  # (m, nλ, 2)
    prior = before.covariance + config.drift**2 * model.period * np.eye(GAINS)
    innovation = measured / model.noise_std - np.einsum("myi,mi->my", slope, before.mean)
    expected = slope @ prior @ slope.transpose(0, 2, 1) + np.eye(len(measured))
    gain = np.linalg.solve(expected, slope @ prior).transpose(0, 2, 1)
    surprise = np.einsum("my,my->m", innovation, np.linalg.solve(expected, innovation[..., np.newaxis])[..., 0])
    log_weight = before.log_weight - 0.5 * (surprise + np.linalg.slogdet(expected)[1])
    learned = ForceBelief(
        before.theta,
        log_weight,
        before.mean + np.einsum("miy,my->mi", gain, innovation),
        prior - gain @ slope @ prior,
    )
    few = 1.0 / (learned.weight**2).sum() < config.fewest * config.points
    return _resample(model, learned) if few else learned


def _resample(model: PlanningModel, old: ForceBelief) -> ForceBelief:
    """The same number of equally likely hypotheses, with the same mean of θ and gains, and a widened covariance of θ.

    The widening is the squared spacing of the old points: they do not resolve a narrower distribution.
    """
    count, size = old.theta.shape
    return _sample(model, old, count, count ** (-2.0 / size) * np.cov(old.theta.T, bias=True))


def condensed(model: PlanningModel, belief: ForceBelief) -> ForceBelief:
    """The smallest number of equally likely hypotheses with the same mean and covariance of θ and gains."""
    size = belief.theta.shape[1]
    return _sample(model, belief, size + GAINS + 1, np.zeros((size, size)))


def _sample(model: PlanningModel, old: ForceBelief, count: int, widening: Array) -> ForceBelief:
    """`count` equally likely hypotheses with the joint moments of θ and gains, plus `widening` (n, n) of θ's
    covariance.
    """
    size = old.theta.shape[1]
    points = np.column_stack([old.theta, old.mean])
    centre = old.weight @ points
    covariance = (old.weight[:, np.newaxis] * (points - centre)).T @ (points - centre)
    covariance[:size, :size] += widening
    # equal gains of all hypotheses would make the covariance singular
    covariance += 1e-12 * np.trace(covariance) * np.eye(len(covariance))
    placed = sigma_points(centre, covariance, count)
    gains = np.broadcast_to(np.einsum("m,mij->ij", old.weight, old.covariance), (count, GAINS, GAINS))
    return ForceBelief(model.parameters.clip(placed[:, :size]), np.zeros(count), placed[:, size:], gains)
