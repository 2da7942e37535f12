"""Quadrature by cubic interpolation between samples."""

import numpy as np

from drake_cafim.typing import Array

NODES = 4
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def gauss(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Points and weights (..., 4) of the four-point Gauss rule on the intervals from `lower` to `upper` (...,)."""
    half = 0.5 * (upper - lower)[..., None]
    return lower[..., None] + half * (1.0 + _POINTS), half * _WEIGHTS


def lagrange(nodes: Array, at: Array) -> Array:
    """Lagrange weights (..., G, 4) of the values at `nodes` (..., 4) in the cubic through them, at `at` (..., G)."""
    apart = at[..., None] - nodes[..., None, :]
    weights = np.empty_like(apart)
    before, after = apart[..., 0] * apart[..., 1], apart[..., 2] * apart[..., 3]
    weights[..., 0], weights[..., 1] = apart[..., 1] * after, apart[..., 0] * after
    weights[..., 2], weights[..., 3] = apart[..., 3] * before, apart[..., 2] * before
    between = nodes[..., :, None] - nodes[..., None, :] + np.eye(NODES)
    return np.asarray(weights / np.prod(between, axis=-1)[..., None, :])
