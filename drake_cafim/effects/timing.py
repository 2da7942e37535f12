"""Sensors whose values belong to another time: late, slow, or by a clock that runs at another rate.

Their inverse reads the recorded channel between its samples by local polynomials. Under test functions that are much
wider than a sample this moves the noise, and hardly smooths it; `diagnosis.reading` makes up for what it does.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_banded

from drake_cafim.compiled import compiled
from drake_cafim.effects.effect import Strength
from drake_cafim.effects.sensor import SensorEffect, whole_sensors
from drake_cafim.local_polynomial import local_polynomial
from drake_cafim.typing import Array

POINTS = 6
"""Samples that a local polynomial goes through."""
MEMORY = 8.0
"""Time constants after which a lag has forgotten."""
SMOOTHING_REACH = 0.015
"""s on either side over which a lagging channel is smoothed before its slope is taken."""


def interpolation(time: Array, at: Array, derivative: int = 0) -> sp.csr_matrix:
    """(K, N): value or a derivative at `at` (K,) s of the local polynomials through samples at `time` (N,) s.

    Before the first and after the last sample the value is held.
    """
    count = min(POINTS, len(time))
    inside = np.clip(at, time[0], time[-1])
    first = np.clip(np.searchsorted(time, inside, side="right") - count // 2, 0, len(time) - count)
    columns = first[:, None] + np.arange(count)
    weights = _weights(time[columns] - inside[:, None], derivative)
    starts = count * np.arange(len(at) + 1)
    return sp.csr_matrix((weights.ravel(), columns.ravel(), starts), shape=(len(at), len(time)))


@compiled
def _weights(offset: Array, derivative: int) -> Array:
    """(K, c) of values at `offset` (K, c) from a point in the derivative there of the polynomial through them.

    Point after point is added, and weights follow for all derivatives up to it (Fornberg, Math. Comp. 51(184), 1988).
    """
    K, count = offset.shape
    result, known = np.empty((K, count)), np.empty((count, derivative + 1))
    for i in range(K):
        x = offset[i]
        known[:] = 0.0
        known[0, 0] = 1.0
        before = 1.0
        for n in range(1, count):
            product = 1.0
            for p in range(n):
                apart = x[n] - x[p]
                product *= apart
                if p == n - 1:
                    for d in range(derivative, 0, -1):
                        known[n, d] = before * (d * known[p, d - 1] - x[p] * known[p, d]) / product
                    known[n, 0] = -before * x[p] * known[p, 0] / product
                for d in range(derivative, 0, -1):
                    known[p, d] = (x[n] * known[p, d] - d * known[p, d - 1]) / apart
                known[p, 0] *= x[n] / apart
            before = product
        result[i] = known[:, derivative]
    return result


@dataclass(frozen=True)
class TimingEffect(SensorEffect):
    """A sensor effect that is linear in the channel's past; on a channel, or on a whole sensor's."""

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        # all channels of a wrench or a pose come through one wire
        yield from (column for column in columns if column.startswith(("q.", "v.")))
        yield from whole_sensors(columns)


@dataclass(frozen=True)
class ShiftedSensor(TimingEffect):
    """A sensor that writes at t the value of another time."""

    @abstractmethod
    def shown(self, time: Array) -> Array:
        """The times s whose values are written at `time` s."""

    @abstractmethod
    def read(self, time: Array) -> Array:
        """The times s at which the values of `time` s are written."""

    def measured(self, time: Array, true: Array) -> Array:
        return np.asarray(self.writing(time) @ true)

    def writing(self, time: Array) -> sp.csr_matrix:
        return interpolation(time, self.shown(time))

    def true(self, time: Array, measured: Array) -> Array:
        return np.asarray(self.correction(time) @ measured)

    def correction(self, time: Array) -> sp.csr_matrix:
        return interpolation(time, self.read(time))


@dataclass(frozen=True)
class SensorDelay(ShiftedSensor):
    """The value of t − delay is written at t."""

    name: ClassVar[str] = "sensor_delay"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("delay", "s", 0.005, lower=0.0, upper=0.2),)
    reference: ClassVar[str] = "Furgale, Rehder, Siegwart, IEEE/RSJ IROS, 2013 (temporal calibration)"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_lag": "slow signals are late by the time constant, whichever of the two it is",
        "actuator_delay": "late position and late effort are the same at one joint; the other joints tell them apart",
        "clock_skew": "over a short recording a growing delay is one of its mean",
    }

    def shown(self, time: Array) -> Array:
        return np.asarray(time - self.values["delay"])

    def read(self, time: Array) -> Array:
        return np.asarray(time + self.values["delay"])

    def columns(self, time: Array, true: Array) -> Array:
        return -np.asarray(_slope(time.tobytes()) @ true)[..., None]


@dataclass(frozen=True)
class SensorLag(TimingEffect):
    """τ ẏ = x − y, and y is written; it starts settled."""

    name: ClassVar[str] = "sensor_lag"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("time_constant", "s", 0.005, lower=0.0, upper=0.5),)
    reference: ClassVar[str] = "Oppenheim, Willsky, Signals and Systems, 1997, §6.5 (first-order systems)"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_delay": "slow signals are late by the time constant, whichever of the two it is",
        "actuator_lag": "late position and late effort are alike at one joint; the other joints tell them apart",
        "sensor_gain_error": "a fast signal comes out smaller",
    }

    def measured(self, time: Array, true: Array) -> Array:
        tau = self.values["time_constant"]
        if tau <= 0.0:
            return true
        # written[k + 1] − kept[k] written[k] = given[k + 1]
        band = np.stack([np.ones(len(time)), np.append(-np.exp(-np.diff(time) / tau), 0.0)])
        return np.asarray(solve_banded((1, 0), band, _given(time, tau) @ true, check_finite=False))

    def writing(self, time: Array) -> sp.csr_matrix:
        tau = self.values["time_constant"]
        if tau <= 0.0:
            return sp.csr_matrix(sp.eye_array(len(time)))
        diagonals, offsets = [np.ones(len(time))], [0]
        for offset in range(1, len(time)):
            apart = time[offset:] - time[:-offset]
            if apart.min() > MEMORY * tau:
                break
            diagonals.append(np.exp(-apart / tau))
            offsets.append(-offset)
        return sp.csr_matrix(sp.diags_array(diagonals, offsets=offsets) @ _given(time, tau))

    def true(self, time: Array, measured: Array) -> Array:
        return np.asarray(self.correction(time) @ measured)

    def correction(self, time: Array) -> sp.csr_matrix:
        # x = y + τ ẏ, with the slope of a smoothed y, for an exact inverse would be all noise
        slope = self.values["time_constant"] * _smooth_slope(time)
        return sp.csr_matrix(sp.eye_array(len(time)) + slope)

    def facing(self, time: Array) -> sp.csr_matrix:
        # a time constant later, as if the channel were only late
        return interpolation(time, time + self.values["time_constant"])

    def columns(self, time: Array, true: Array) -> Array:
        return -np.asarray(_slope(time.tobytes()) @ true)[..., None]


@dataclass(frozen=True)
class ClockSkew(ShiftedSensor):
    """The value of t·(1 + skew) is written at t."""

    name: ClassVar[str] = "clock_skew"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("skew", "1", 1e-3, lower=-0.1, upper=0.1),)
    reference: ClassVar[str] = "Mills, Internet time synchronization, IEEE Trans. Communications 39(10), 1991"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_delay": "over a short recording a growing delay is one of its mean",
        "sensor_drift": "in a steady motion a growing delay is a drift",
    }

    def shown(self, time: Array) -> Array:
        return np.asarray(time * (1.0 + self.values["skew"]))

    def read(self, time: Array) -> Array:
        return np.asarray(time / (1.0 + self.values["skew"]))

    def columns(self, time: Array, true: Array) -> Array:
        slope = np.asarray(_slope(time.tobytes()) @ true)
        return np.asarray((time[:, None] * slope)[..., None])


def _given(time: Array, tau: float) -> sp.csr_matrix:
    """(N, N): what each step adds to what is written, exact for a signal that is a parabola between two samples."""
    steps = np.diff(time)
    a = steps / tau
    kept = np.exp(-a)
    after = 1.0 - (1.0 - kept) / a
    straight = sp.diags_array([np.concatenate([[1.0], after]), 1.0 - kept - after], offsets=[0, -1])
    if len(time) < 3:
        return sp.csr_matrix(straight)
    # ∫ e^(−u/τ)/τ · u (h − u)/2 du: how far a parabola of unit curvature lies below its chord
    below = 0.5 * tau**2 * (a * (1.0 - (1.0 + a) * kept) - 2.0 + (a**2 + 2.0 * a + 2.0) * kept)
    return sp.csr_matrix(straight - sp.diags_array(np.append(0.0, below)) @ _curvature(time.tobytes()))


@lru_cache(maxsize=16)
def _curvature(time: bytes) -> sp.csr_matrix:
    """The second derivative of a channel over the step to each sample, kept for the recordings at hand."""
    t = np.frombuffer(time)
    return interpolation(t, np.append(t[0], 0.5 * (t[1:] + t[:-1])), derivative=2)


@lru_cache(maxsize=16)
def _slope(time: bytes) -> sp.csr_matrix:
    """The slope of a channel at `time`, kept for the recordings at hand."""
    return interpolation(np.frombuffer(time), np.frombuffer(time), derivative=1)


def _smooth_slope(time: Array) -> sp.csr_matrix:
    """The slope of a smoothed channel at `time`."""
    return local_polynomial(time, SMOOTHING_REACH, 5, 1, at_least=3)
