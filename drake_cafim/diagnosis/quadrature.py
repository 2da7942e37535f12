"""Cubic interpolation between samples, and what it misses of a function whose slope jumps."""

import numpy as np

from drake_cafim.typing import Array, Indices

NODES = 4
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def gauss(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Points and weights (..., 4) of Gauss's rule on the intervals from `lower` to `upper`."""
    half = 0.5 * (upper - lower)[..., None]
    return lower[..., None] + half * (1.0 + _POINTS), half * _WEIGHTS


def lagrange(nodes: Array, at: Array) -> Array:
    """Weights (..., G, 4) of values at `nodes` (..., 4) in the cubic through them, at the points `at` (..., G)."""
    apart = at[..., None] - nodes[..., None, :]
    weights = np.empty_like(apart)
    before, after = apart[..., 0] * apart[..., 1], apart[..., 2] * apart[..., 3]
    weights[..., 0], weights[..., 1] = apart[..., 1] * after, apart[..., 0] * after
    weights[..., 2], weights[..., 3] = apart[..., 3] * before, apart[..., 2] * before
    between = nodes[..., :, None] - nodes[..., None, :] + np.eye(NODES)
    return np.asarray(weights / np.prod(between, axis=-1)[..., None, :])


def missed_kink(time: Array, at: Array, order: int = 1) -> Array:
    """∫ e dt, ∫ (t − τ) e dt and ∫ ½ (t − τ)² e dt, (3, K), of e = (t − τ)₊ⁿ/n! less its cubic interpolant.

    n is `order`. Each interval between samples at `time` (N,) is interpolated through its four nearest samples; τ are
    the values of `at` (K,). On an even grid and at a sample the first is h²/12 for n = 1, what the trapezoid rule
    misses (Euler–Maclaurin).
    """
    own: Indices = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    moments = np.zeros((3, len(at)))
    # further intervals take all their samples from one side of the kink
    for offset in (-2, -1, 0, 1, 2):
        interval = own + offset
        inside = (interval >= 0) & (interval < len(time) - 1)
        interval = np.clip(interval, 0, len(time) - 2)
        nodes = time[np.clip(interval - 1, 0, len(time) - NODES)[:, None] + np.arange(NODES)]
        sampled = _power(nodes - at[:, None], order)
        kink = np.clip(at, time[interval], time[interval + 1])
        # before and after the kink, of which an interval beside its own has but one
        parts = [(time[interval], kink)] * (offset <= 0) + [(kink, time[interval + 1])] * (offset >= 0)
        for lower, upper in parts:
            t, weight = gauss(lower, upper)
            since = t - at[:, None]
            error = _power(since, order) - (lagrange(nodes, t) @ sampled[..., None])[..., 0]
            weighed = np.where(inside[:, None], weight * error, 0.0)
            for n in range(3):
                moments[n] += np.sum(weighed, axis=1) / max(n, 1)
                weighed = weighed * since
    return moments


def _power(x: Array, order: int) -> Array:
    """x₊ⁿ/n!, n = 1 or 2."""
    return np.asarray(np.clip(x, 0.0, None) ** order / order, dtype=float)
