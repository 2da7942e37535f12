"""The points of time at which joint laws are integrated: finer than the samples where a law may change its sign.

Within a sample interval a velocity that passes zero turns dry friction round. The laws are therefore evaluated along
the estimated motion between samples, by two-point Gauss rules on pieces of an interval in which no velocity changes by
more than a fraction of the width over which friction's sign changes.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array, Flags, Indices

LARGEST_CHANGE = 2.5e-3
"""Change of a velocity near zero within a piece, rad/s or m/s: half of the nominal width of friction's sign change."""
NEAR_ZERO = 0.02
"""Velocity below which dry friction changes noticeably, rad/s or m/s: four of these widths."""
MOST_PIECES = 16
"""Largest number of pieces of an interval."""
GAUSS = 0.5 - 0.5 / np.sqrt(3.0)
"""Place of the first point of the two-point Gauss rule, as a share of the piece."""


@dataclass(frozen=True)
class LawPoints:
    """P points of a recording: the `interval` (P,) between samples that holds each, and its place `share` (P,) there.

    `value` (M, P): `value @ f` is ∫ w f dt for values f (P,) at the points.
    """

    interval: Indices
    share: Array
    value: sp.csr_matrix

    def lasting(self, time: Array) -> Array:
        """(P,) s, the time that each point represents."""
        count = np.bincount(self.interval, minlength=len(time) - 1)
        return np.asarray((np.diff(time) / np.maximum(count, 1))[self.interval])

    def between(self, values: Array) -> Array:
        """`values` (N, ...) of the samples at the points (P, ...), linear between samples."""
        share = self.share.reshape(-1, *([1] * (values.ndim - 1)))
        return np.asarray(values[self.interval] + share * (values[self.interval + 1] - values[self.interval]))

    def samples(self, time: Array, q: Array, v: Array, u: Array, v_std: Array, ramped: bool) -> JointSamples:
        """One joint's motion and effort (N,) at the points, its position by cubic Hermite interpolation."""
        k, s = self.interval, self.share
        h = np.diff(time)[k]
        rise = q[k + 1] - q[k]
        bend = rise / h - 0.5 * (v[k] + v[k + 1])
        velocity = v[k] + s * (v[k + 1] - v[k]) + 6.0 * s * (1.0 - s) * bend
        position = q[k] + h * (s * v[k] + 0.5 * s**2 * (v[k + 1] - v[k]) + (3.0 * s**2 - 2.0 * s**3) * bend)
        effort = u[k] + s * (u[k + 1] - u[k]) if ramped else u[k]
        std = v_std[k] + s * (v_std[k + 1] - v_std[k])
        # the change of velocity from point to point acts like an error of it, as in `joint_samples_of`
        apart = np.abs(np.gradient(velocity)) / np.sqrt(2.0 * np.pi)
        reach = 0.5 * np.abs(np.gradient(position))
        return JointSamples(position, velocity, effort, np.hypot(std, apart), reach, in_order=True)


def lay_points(windows: Windows, v: Array) -> LawPoints:
    """The points for velocities `v` (N, n) at the samples."""
    pieces = _pieces(v)
    interval = np.repeat(np.arange(len(pieces)), pieces)
    begin = np.arange(len(interval)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    length = 1.0 / pieces[interval]
    share = np.stack([(begin + GAUSS) * length, (begin + 1.0 - GAUSS) * length], axis=1).ravel()
    interval, length = np.repeat(interval, 2), np.repeat(length, 2)
    h = np.diff(windows.time)[interval]
    return LawPoints(interval, share, windows.at(interval, 0.5 * length * h))


def _pieces(v: Array) -> Indices:
    """(N − 1,) number of pieces of each interval."""
    change = np.abs(np.diff(v, axis=0))
    slow: Flags = np.minimum(np.abs(v[1:]), np.abs(v[:-1])) < NEAR_ZERO + change
    needed = np.where(slow, np.ceil(change / LARGEST_CHANGE), 1.0)
    return np.asarray(np.clip(np.max(needed, axis=1, initial=1.0), 1, MOST_PIECES), dtype=np.int64)
