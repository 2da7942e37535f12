"""Quadrature by cubic interpolation between samples, and its error for a function with a jump in a derivative."""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices

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


def missed_kink(time: Array, at: Array, order: int = 1) -> Array:
    """∫ e dt, ∫ (t − τ) e dt and ∫ ½ (t − τ)² e dt, (3, K), of the interpolation error e of (t − τ)₊ⁿ/n!.

    n is `order`, 1 to 3, and e is the function less its interpolant. Each interval between samples at `time` (N,) s is
    interpolated by the cubic through its four nearest samples; τ are the values of `at` (K,) s. On an even grid of step
    h and with τ at a sample, the first is h²/12 for n = 1, the error of the trapezoid rule (Euler–Maclaurin).
    """
    interval: Indices = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    times, kinks = np.ascontiguousarray(time), np.ascontiguousarray(at)
    return np.asarray(_integrate_error(times, kinks, interval, order, _POINTS, _WEIGHTS))


@compiled
def _integrate_error(time: Array, at: Array, within: Indices, order: int, points: Array, weights: Array) -> Array:
    """`missed_kink` of kinks that lie in the intervals with the indices `within` (K,)."""
    N, K = len(time), len(at)
    factorial = 1.0 if order == 1 else 2.0 if order == 2 else 6.0
    moments, x, sampled = np.zeros((3, K)), np.empty(NODES), np.empty(NODES)
    for k in range(K):
        # cubics that use samples on both sides of the kink reach two intervals beyond its interval
        for interval in range(max(within[k] - 2, 0), min(within[k] + 3, N - 1)):
            first = min(max(interval - 1, 0), N - NODES)
            if time[first] >= at[k] or time[first + NODES - 1] <= at[k]:
                # all four samples are on one side of the kink, where the cubic is exact
                continue
            for a in range(NODES):
                x[a] = time[first + a] - at[k]
                sampled[a] = max(x[a], 0.0) ** order / factorial
            # divided by the denominators of Lagrange's polynomials
            for a in range(NODES):
                for b in range(NODES):
                    if b != a:
                        sampled[a] /= x[a] - x[b]
            kink = min(max(at[k], time[interval]), time[interval + 1])
            for part in range(2):
                # before and after the kink; an interval that does not contain it has only one of the two
                lower, upper = (time[interval], kink) if part == 0 else (kink, time[interval + 1])
                half = 0.5 * (upper - lower)
                if half <= 0.0:
                    continue
                for g in range(len(points)):
                    since = lower + half * (1.0 + points[g]) - at[k]
                    error = max(since, 0.0) ** order / factorial
                    for a in range(NODES):
                        share = sampled[a]
                        for b in range(NODES):
                            if b != a:
                                share *= since - x[b]
                        error -= share
                    missed = half * weights[g] * error
                    moments[0, k] += missed
                    moments[1, k] += missed * since
                    moments[2, k] += missed * since * since / 2.0
    return moments
