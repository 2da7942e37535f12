"""Sensor effects on timing: delay, first-order lag, and a clock of a different rate.

Their inverse interpolates the recorded channel between its samples by local polynomials. Under test functions that are
much wider than a sample interval this shifts the noise and hardly smooths it; the diagnosis accounts for that in the
noise covariance.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_banded

from drake_cafim.effects.effect import Strength
from drake_cafim.effects.sensor import SensorEffect, whole_sensors
from drake_cafim.numerics.compiled import compiled
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array

POINTS = 6
"""Number of samples that a local polynomial interpolates."""
MEMORY = 8.0
"""Multiple of the time constant after which a lag's impulse response exp(−t/τ) is neglected."""
SMOOTHING_REACH = 0.015
"""s, half width of the smoothing of a lagging channel before it is differentiated."""


def interpolation(time: Array, at: Array, derivative: int = 0) -> sp.csr_matrix:
    """Matrix (K, N) from samples at `time` (N,) s to the local polynomials' value or derivative at `at` (K,) s.

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
    """Weights (K, c) of values at `offset` (K, c) s in the `derivative` at offset 0 of their interpolating polynomial.

    Computed by adding one point after the other, for all derivatives up to that one (Fornberg, Math. Comp. 51(184),
    1988).
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
        for n in range(count):
            result[i, n] = known[n, derivative]
    return result


@dataclass(frozen=True)
class TimingEffect(SensorEffect):
    """A sensor effect that is a linear filter of a channel, or of all channels of a sensor."""

    late: ClassVar[bool] = True
    needs_motion: ClassVar[bool] = True

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        # all channels of a wrench or a pose come in one message, so they share its delay
        yield from (column for column in columns if column.startswith(("q.", "v.")))
        yield from whole_sensors(columns)


@dataclass(frozen=True)
class ShiftedSensor(TimingEffect):
    """A sensor that records at t the true value of another time."""

    shifts: ClassVar[bool] = True

    @abstractmethod
    def shown(self, time: Array) -> Array:
        """The times s whose values are recorded at `time` s."""

    @abstractmethod
    def read(self, time: Array) -> Array:
        """The times s at which the values of `time` s are recorded."""

    def measured(self, time: Array, true: Array) -> Array:
        return np.asarray(self.filter_matrix(time) @ true)

    def filter_matrix(self, time: Array) -> sp.csr_matrix:
        return interpolation(time, self.shown(time))

    def true(self, time: Array, measured: Array) -> Array:
        return np.asarray(self.correction(time) @ measured)

    def correction(self, time: Array) -> sp.csr_matrix:
        return interpolation(time, self.read(time))


@dataclass(frozen=True)
class SensorDelay(ShiftedSensor):
    """measured(t) = true(t − delay)."""

    name: ClassVar[str] = "sensor_delay"
    in_throws: ClassVar[bool] = False  # a delay common to all of a throw's channels is not observable
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("delay", "s", 0.005, lower=0.0, upper=0.2),)
    reference: ClassVar[str] = "Furgale, Rehder, Siegwart, IEEE/RSJ IROS, 2013 (temporal calibration)"
    formula: ClassVar[str] = "reads the truth of <i>t</i> − τ"
    words: ClassVar[str] = "reads the past"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_lag": "slow signals are late by the time constant, whichever of the two it is",
        "actuator_delay": "late position and late effort are the same at one joint; the other joints tell them apart",
        "command_delay": "late position and late command are the same at one joint; the other joints tell them apart",
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
    """τ ẏ = x − y for the true value x; y is recorded, and starts in steady state, y = x."""

    name: ClassVar[str] = "sensor_lag"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("time_constant", "s", 0.005, lower=0.0, upper=0.5),)
    reference: ClassVar[str] = "Oppenheim, Willsky, Signals and Systems, 1997, §6.5 (first-order systems)"
    formula: ClassVar[str] = "τ <i>ẏ</i> = truth − <i>y</i>, <i>y</i> is read"
    words: ClassVar[str] = "follows the truth slowly"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_delay": "slow signals are late by the time constant, whichever of the two it is",
        "actuator_lag": "late position and late effort are alike at one joint; the other joints tell them apart",
        "command_lag": "late position and late command are alike at one joint; the other joints tell them apart",
        "sensor_gain_error": "a fast signal comes out smaller",
    }

    @property
    def settling(self) -> float:
        # of a hypothesis, which has no values, it is not known yet
        return self.values.get("time_constant", 0.0)

    def measured(self, time: Array, true: Array) -> Array:
        tau = self.values["time_constant"]
        if tau <= 0.0:
            return true
        # written[k + 1] − kept[k] written[k] = (input matrix @ true)[k + 1]
        band = np.stack([np.ones(len(time)), np.append(-np.exp(-np.diff(time) / tau), 0.0)])
        return np.asarray(solve_banded((1, 0), band, _input_matrix(time.tobytes(), tau) @ true, check_finite=False))

    def filter_matrix(self, time: Array) -> sp.csr_matrix:
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
        return sp.csr_matrix(sp.diags_array(diagonals, offsets=offsets) @ _input_matrix(time.tobytes(), tau))

    def true(self, time: Array, measured: Array) -> Array:
        return np.asarray(self.correction(time) @ measured)

    def correction(self, time: Array) -> sp.csr_matrix:
        # x = y + τ ẏ, with ẏ from a smoothed y: the exact inverse would amplify the noise
        slope = self.values["time_constant"] * _smooth_slope(time)
        return sp.csr_matrix(sp.eye_array(len(time)) + slope)

    def kinematic_correction(self, time: Array) -> sp.csr_matrix:
        # to first order in τ a lag is a delay by the time constant
        return interpolation(time, time + self.values["time_constant"])

    def columns(self, time: Array, true: Array) -> Array:
        return -np.asarray(_slope(time.tobytes()) @ true)[..., None]


@dataclass(frozen=True)
class ClockSkew(ShiftedSensor):
    """measured(t) = true(t·(1 + skew))."""

    name: ClassVar[str] = "clock_skew"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("skew", "1", 1e-3, lower=-0.1, upper=0.1),)
    reference: ClassVar[str] = "Mills, Internet time synchronization, IEEE Trans. Communications 39(10), 1991"
    formula: ClassVar[str] = "reads the truth of <i>t</i> (1 + <i>s</i>)"
    words: ClassVar[str] = "runs on a clock of its own"
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


@lru_cache(maxsize=16)
def _input_matrix(grid: bytes, tau: float) -> sp.csr_matrix:
    """Input matrix (N, N) of the lag's recursion; exact for a signal that is a parabola between two samples.

    Cached by time grid and time constant, which most changes of a model leave as they are.
    """
    time = np.frombuffer(grid)
    steps = np.diff(time)
    a = steps / tau
    kept = np.exp(-a)
    after = 1.0 - (1.0 - kept) / a
    straight = sp.diags_array([np.concatenate([[1.0], after]), 1.0 - kept - after], offsets=[0, -1])
    if len(time) < 3:
        return sp.csr_matrix(straight)
    # ∫ e^(−u/τ)/τ · u (h − u)/2 du: how far a parabola of unit curvature lies below its chord
    below = 0.5 * tau**2 * (a * (1.0 - (1.0 + a) * kept) - 2.0 + (a**2 + 2.0 * a + 2.0) * kept)
    return sp.csr_matrix(straight - sp.diags_array(np.append(0.0, below)) @ _curvature(grid))


@lru_cache(maxsize=16)
def _curvature(time: bytes) -> sp.csr_matrix:
    """Matrix (N, N) to a channel's second derivative midway in the step to each sample; cached by time grid."""
    t = np.frombuffer(time)
    return interpolation(t, np.append(t[0], 0.5 * (t[1:] + t[:-1])), derivative=2)


@lru_cache(maxsize=16)
def _slope(time: bytes) -> sp.csr_matrix:
    """Matrix (N, N) to a channel's derivative at its samples; cached by time grid."""
    return interpolation(np.frombuffer(time), np.frombuffer(time), derivative=1)


def _smooth_slope(time: Array) -> sp.csr_matrix:
    """Matrix (N, N) to the derivative of a smoothed channel at its samples."""
    return local_polynomial(time, SMOOTHING_REACH, 5, 1, at_least=3)
