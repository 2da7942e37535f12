"""Sums over windows of even samples, as weights of samples that are not quite even.

A cubic spline takes the values to even times. It forgets a sample within a few others, so that one spline through
combs, whose teeth are further apart than a window and all that it can feel, tells the weights of every sample.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import csr_array

from .robots import Array
from .strength import Windows

MARGIN = 40
"""Samples beyond a window, of which a spline feels less than 1e-16."""


def sums_of(windows: Windows, time: Array, weights: tuple[Array, ...]) -> list[list[csr_array]]:
    """For each of the weights and each recording's times (B, N), what makes sums over windows of values there."""
    samples = time.shape[1]
    if np.allclose(np.diff(time, axis=1), windows.step, rtol=1e-6, atol=0.0):
        return [[windows.sums(samples, weight)] * len(time) for weight in weights]
    return [list(found) for found in zip(*(_uneven(windows, own, weights) for own in time), strict=True)]


def _uneven(windows: Windows, time: Array, weights: tuple[Array, ...]) -> list[csr_array]:
    """For each of the weights, as a spline through values at times (N,) has them at even times."""
    samples, period = len(time), windows.length + 2 * MARGIN
    combs = np.zeros((samples, period))
    combs[np.arange(samples), np.arange(samples) % period] = 1.0
    even = CubicSpline(time, combs)(time[0] + windows.step * np.arange(samples))
    near = windows.starts[:, None] + np.arange(-MARGIN, windows.length + MARGIN)
    row, place = np.nonzero((near >= 0) & (near < samples))
    near = near[row, place]
    shape = (len(windows.starts), samples)
    return [
        csr_array(((windows.sums(samples, w) @ even)[row, near % period], (row, near)), shape=shape) for w in weights
    ]
