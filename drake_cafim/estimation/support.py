"""What the data leave open, where the posterior is not the narrow Gaussian at its mode that Laplace's method takes.

A size of which nothing was felt is known by where no contact was: the posterior is flat up to there. Its mode is at the
edge, where the curvature, large on one side and none on the other, says nothing of its width.

Where the data determine a curve, as the product of friction and stiffness, the posterior's mean lies beside it: no
Gaussian has both the posterior's moments and what the data determine. By Jensen's inequality the mean of a posterior
with a convex ℓ has a cost of at most the mean cost; where it has more, the mode and its curvature stand.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.estimation.problem import MapProblem
from drake_cafim.estimation.shooting import MapEstimate
from drake_cafim.typing import Array

POINTS = 41
"""Of the grid, in each dimension, over three prior stds on both sides of the prior's mean."""
MOST = 2
"""The largest number of sought parameters for which there is a grid."""
FACTOR = 2.0
"""The posterior's moments replace Laplace's where a std differs by this factor."""


def with_moments(problem: MapProblem, estimate: MapEstimate) -> MapEstimate:
    """The estimate, with the mean and covariance of the posterior on a grid where these differ from its mode's.

    The grid is over the sought parameters, the nuisance ones at their estimates. Without a grid (more than `MOST`
    sought parameters, a touched object with a state, a prior without a std) the estimate stands, and where the
    posterior's mean is less probable than its points are on average.
    """
    sought = problem.model.parameters.sought
    spread = problem.prior.std[sought]
    if sought.sum() > MOST or problem.model.state_size or not np.isfinite(spread).all():
        return estimate
    mean, covariance, spacing, average = _moments(problem, estimate.belief.mean, sought)
    std = np.sqrt(np.diag(covariance))
    ratio = std / estimate.belief.std[sought]
    # a posterior narrower than the grid's spacing is not resolved
    if not ((std > spacing) & ((ratio > FACTOR) | (ratio < 1.0 / FACTOR))).any():
        return estimate
    known = estimate.belief
    centre, nuisance = known.mean.copy(), np.logical_not(sought)
    whole = np.where(np.outer(nuisance, nuisance), known.covariance, 0.0)
    centre[sought], whole[np.outer(sought, sought)] = mean, covariance.ravel()
    if problem.cost(centre) > average:
        return estimate
    return replace(estimate, belief=Belief(known.names, centre, whole))


def _moments(problem: MapProblem, theta: Array, sought: Array) -> tuple[Array, Array, Array, float]:
    """Mean (k,), covariance (k, k) of the posterior of the sought parameters on the grid, its spacing (k,), mean ℓ."""
    lower, upper = (bound[sought] for bound in problem.model.parameters.bounds)
    middle, reach = problem.prior.mean[sought], 3.0 * problem.prior.std[sought]
    axes = np.linspace(np.maximum(lower, middle - reach), np.minimum(upper, middle + reach), POINTS)
    grid = np.array(list(product(*axes.T)))
    points = np.repeat(theta[np.newaxis], len(grid), axis=0)
    points[:, sought] = grid
    costs = problem.costs(points)
    weight = np.exp(costs.min() - costs)
    weight = weight / weight.sum()
    mean = weight @ grid
    away = grid - mean
    spacing = axes[1] - axes[0]
    # each point stands for its cell
    covariance = (weight[:, np.newaxis] * away).T @ away + np.diag(spacing**2 / 12.0)
    return mean, covariance, spacing, float(weight @ costs)
