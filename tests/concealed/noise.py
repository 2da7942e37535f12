"""Measurement noise and clocks: white, coloured (declared or not), quantised encoders, jitter of the sampling time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .recursion import followed
from .robots import Array

KINDS = ("white", "white", "white", "coloured_declared", "quantised")


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one kind of channel: std of a sample (SI), OU correlation time (s), step of an encoder (SI)."""

    std: float
    correlation_time: float = 0.0
    quantum: float = 0.0

    @property
    def declared_std(self) -> float:
        """Std of noise and rounding together."""
        return float(np.hypot(self.std, self.quantum / np.sqrt(12.0)))

    def draw(self, rng: np.random.Generator, time: Array, width: int) -> Array:
        """Noise (B, N, width) at times (B, N), rounding left out."""
        white = rng.normal(size=(*time.shape, width))
        if self.correlation_time > 0.0:
            white = _ornstein_uhlenbeck(white, time, self.correlation_time)
        return self.std * white

    def measure(self, value: Array, noise: Array) -> Array:
        """What the sensor reports of `value`."""
        reading = value + noise
        return np.round(reading / self.quantum) * self.quantum if self.quantum > 0.0 else reading


def _ornstein_uhlenbeck(white: Array, time: Array, correlation_time: float) -> Array:
    """Stationary unit-variance noise with autocorrelation exp(-|dt|/correlation_time)."""
    keep = np.exp(-np.diff(time, axis=1, prepend=-np.inf) / correlation_time)
    fresh = np.sqrt(1.0 - keep**2)
    return followed(keep, fresh[:, :, None] * white)


@dataclass(frozen=True)
class Clock:
    """Sampling: step (s), relative jitter of the true instants, std (s) of the error of the stamps."""

    step: float
    jitter: float = 0.0
    stamp_error: float = 0.0

    def times(self, rng: np.random.Generator, members: int, samples: int) -> Array:
        """True sampling instants (B, N), strictly increasing."""
        regular = np.tile(self.step * np.arange(samples), (members, 1))
        if self.jitter == 0.0:
            return regular
        offset = rng.uniform(-0.5, 0.5, regular.shape) * self.jitter * self.step
        offset[:, 0] = 0.0
        return regular + offset

    def stamps(self, rng: np.random.Generator, time: Array) -> Array:
        """Instants as recorded."""
        if self.stamp_error == 0.0:
            return time
        return time + np.clip(rng.normal(0.0, self.stamp_error, time.shape), -0.2 * self.step, 0.2 * self.step)


def loguniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
