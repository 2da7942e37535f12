"""Equally weighted points with the mean and covariance of a normal distribution."""

from functools import cache

import numpy as np
from scipy.stats import norm

from drake_cafim.typing import Array


def sigma_points(mean: Array, covariance: Array, count: int) -> Array:
    """Points (count, n), count > n, of equal weight, with exactly the given mean (n,) and covariance (n, n).

    Quantiles of the normal distribution at the points of a rank-1 lattice, standardised.
    """
    return np.asarray(mean + _standard_points(len(mean), count) @ np.linalg.cholesky(covariance).T)


@cache
def _standard_points(size: int, count: int) -> Array:
    """The points (count, n) of mean zero and unit covariance."""
    # the generalised golden ratio, root of x^n = x + 1: its powers spread a lattice evenly (Roberts)
    ratio = max(np.roots([1.0, *[0.0] * (size - 2), -1.0, -1.0]).real) if size > 1 else 2.0
    steps = np.array([1.0 / count, *(ratio ** -np.arange(1.0, size))])
    z = norm.ppf((0.5 * steps[0] + np.outer(np.arange(count), steps)) % 1.0)
    z -= z.mean(axis=0)
    return np.asarray(z @ np.linalg.inv(np.linalg.cholesky(z.T @ z / count)).T)
