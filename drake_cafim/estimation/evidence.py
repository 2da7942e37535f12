"""The evidence of a planning model: how probable the data are under it, its parameters integrated out."""

from itertools import product

import numpy as np
from scipy.stats import norm

from drake_cafim.estimation.problem import MapProblem
from drake_cafim.estimation.shooting import MapEstimate
from drake_cafim.typing import Array

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(8)
# an even number: none at the mode itself, which may be on a bound and would count in full
MOST = 2
"""The largest number of parameters over which `log_evidence` integrates on a grid."""


def log_evidence(problem: MapProblem, estimate: MapEstimate) -> float:
    """log ∫ p(y | θ) p(θ) dθ, up to a constant that all models of the same data share.

    Laplace's approximation at the estimate θ̂, −ℓ(θ̂) + ½ log det Σ − ½ log det Σ₀, divided by the prior's probability
    within the parameters' bounds. Up to two parameters the integral over the posterior is not taken as Gaussian but
    done on the 8ⁿ points of Gauss–Hermite quadrature about θ̂, so that a posterior that is skew, or cut by a bound,
    counts as it is.
    """
    belief, prior = estimate.belief, problem.prior
    lower, upper = problem.model.parameters.bounds
    inside = norm.cdf(upper, prior.mean, prior.std) - norm.cdf(lower, prior.mean, prior.std)
    volume = 0.5 * (_log_determinant(belief.covariance) - _log_determinant(prior.covariance))
    least = problem.cost(belief.mean)
    correction = 0.0
    if len(belief.mean) <= MOST:
        correction = _log_quadrature(problem, estimate, least)
    return float(-least + volume + correction - np.log(np.maximum(inside, 1e-12)).sum())


def _log_quadrature(problem: MapProblem, estimate: MapEstimate, least: float) -> float:
    """log of the posterior's integral over that of the Gaussian with its mode and curvature."""
    mean, size = estimate.belief.mean, len(estimate.belief.mean)
    root = np.linalg.cholesky(estimate.belief.covariance)
    lower, upper = problem.model.parameters.bounds
    total = 0.0
    for index in product(range(len(NODES)), repeat=size):
        z = NODES[list(index)]
        theta = mean + root @ z
        if np.all((lower <= theta) & (theta <= upper)):
            weight = np.prod(WEIGHTS[list(index)]) / np.sqrt(2.0 * np.pi) ** size
            total += weight * np.exp(0.5 * z @ z - (problem.cost(theta) - least))
    return float(np.log(max(total, 1e-300)))


def _log_determinant(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])
