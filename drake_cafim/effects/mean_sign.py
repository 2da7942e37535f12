"""The mean of a dry friction's smoothed sign, tanh(v/w), over a Gaussian error of the velocity.

tanh is approximated by a mixture of normal distribution functions, as the logistic function is (Monahan, Stefanski, in
Handbook of the Logistic Distribution, 1992, ch. 22). With v̂ the measured velocity and s the std of its error,

    E[erf(c v/w)] = erf(c v̂/√(w² + 2 c² s²))

is exact for each term, whether s is large or small against w.
"""

from dataclasses import dataclass
from math import erf

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

SIGN = ((0.065202, 0.457608), (0.451595, 1.001436), (0.386803, 0.679370), (0.096400, 1.466001))
"""tanh(x) ≈ Σ p erf(c x), (p, c) by least squares; within 1.3·10⁻⁵."""
REST = ((0.287868, 0.514127), (0.445991, 1.933605), (0.177266, 12.046109), (0.075409, 151.314799))
"""1 − |tanh(x)| ≈ Σ a exp(−g x²), (a, g) by least squares; within 0.014 at the cusp x = 0, its area within 0.4 %."""
SETTLED = 6.1
"""x from which on erf(x) is 1, and exp(−x²) beside 1 is 0, to rounding: most samples of a motion are beyond."""


@dataclass(frozen=True)
class MeanSign:
    """The mean of tanh(v/w) over v's error, and its slopes in v and in the error's standard deviation; each (N,)."""

    value: Array
    by_v: Array
    by_std: Array

    @classmethod
    def of(cls, v: Array, v_std: Array | float, width: float) -> "MeanSign":
        """For velocities `v` (N,) with standard deviation `v_std` (N,), and w = `width`; all in rad/s or m/s."""
        std = np.asarray(v_std)
        if not np.any(std):
            sign = np.tanh(v / width)
            return cls(sign, (1.0 - sign**2) / width, np.zeros_like(sign))
        return cls(*_mean_sign(v, np.broadcast_to(std, v.shape), float(width)))


@compiled
def _mean_sign(v: Array, std: Array, width: float) -> tuple[Array, Array, Array]:
    """The numbers of a `MeanSign`, where `std` (N,) is not zero everywhere."""
    value, by_v, by_std = np.empty_like(v), np.zeros_like(v), np.zeros_like(v)
    most, widest = 0.0, SIGN[0][1]
    for share, rate in SIGN:
        most += share
        widest = min(widest, rate)
    for k in range(len(v)):
        variance = 2.0 * std[k] ** 2
        if abs(v[k]) >= SETTLED / widest * np.sqrt(width**2 + widest**2 * variance):
            value[k] = most * np.sign(v[k])
            continue
        mean, slope, change = 0.0, 0.0, 0.0
        for share, rate in SIGN:
            narrowed = rate / np.sqrt(width**2 + rate**2 * variance)
            x = narrowed * v[k]
            bell = share * 2.0 / np.sqrt(np.pi) * np.exp(-(x**2))
            mean += share * erf(x)
            slope += bell * narrowed
            change -= 2.0 * bell * v[k] * std[k] * narrowed**3
        value[k], by_v[k], by_std[k] = mean, slope, change
    return value, by_v, by_std


def mean_sides(sign: MeanSign, v: Array, v_std: Array | float, width: float) -> tuple[Array, Array]:
    """The means of −max(0, tanh(v/w)) and max(0, −tanh(v/w)), and their slopes in v; each (N, 2).

    They are −½ (|t| + t) and ½ (|t| − t) with t = tanh(v/w), of which `sign` is the mean.
    """
    std = np.asarray(v_std)
    if np.any(std):
        size, size_by_v = _mean_size(v, np.broadcast_to(std, v.shape), float(width))
    else:
        size, size_by_v = np.abs(sign.value), np.sign(v) * sign.by_v
    values = np.stack([-0.5 * (size + sign.value), 0.5 * (size - sign.value)], axis=1)
    return values, np.stack([-0.5 * (size_by_v + sign.by_v), 0.5 * (size_by_v - sign.by_v)], axis=1)


@compiled
def _mean_size(v: Array, std: Array, width: float) -> tuple[Array, Array]:
    """The mean of |tanh(v/w)| and its slope in v, each (N,), where `std` (N,) is not zero everywhere."""
    size, by_v = np.ones_like(v), np.zeros_like(v)
    widest = REST[0][1]
    for _, rate in REST:
        widest = min(widest, rate)
    for k in range(len(v)):
        variance = 2.0 * std[k] ** 2
        if abs(v[k]) >= SETTLED * np.sqrt(width**2 / widest + variance):
            continue
        for share, rate in REST:
            spread = width**2 + rate * variance
            bell = share * width / np.sqrt(spread) * np.exp(-rate * v[k] ** 2 / spread)
            size[k] -= bell
            by_v[k] += 2.0 * rate * v[k] / spread * bell
    return size, by_v
