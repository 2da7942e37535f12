"""Cubic Hermite splines through equally spaced knots on [0, 1], as matrices that multiply the knots."""

from functools import cache

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from drake_cafim.typing import Array


@cache
def _sampling_matrix(knots: int, horizon: int, shift: float) -> Array:
    places = np.linspace(0.0, 1.0, knots)
    identity = np.eye(knots)
    tangents = np.gradient(identity, places, axis=0) if knots > 1 else np.zeros_like(identity)
    moments = np.minimum(np.linspace(0.0, 1.0, horizon) + shift, 1.0)
    result: Array = CubicHermiteSpline(places, identity, tangents)(moments)
    result.setflags(write=False)
    return result


def sample(knots: Array, horizon: int) -> Array:
    """Commands (..., H, nu) along splines through knots (..., K, nu); tangents are central differences."""
    return np.asarray(_sampling_matrix(knots.shape[-2], horizon, 0.0) @ knots)


def shift(knots: Array, horizon: int) -> Array:
    """Knots (K, nu) of the same spline shifted by one of `horizon` samples; constant beyond its end."""
    count = knots.shape[-2]
    return np.asarray(_sampling_matrix(count, count, 1.0 / (horizon - 1)) @ knots)
