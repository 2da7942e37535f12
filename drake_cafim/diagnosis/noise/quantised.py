"""Quantisation noise: white only while a channel moves by more than a quantisation step from sample to sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, NoiseProcess
from drake_cafim.diagnosis.thresholds import LATTICE_DEVIATION, LONGEST_ROUNDING_DWELL, QUANTISED_WAY_INTERVAL
from drake_cafim.numerics.compiled import compiled
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

DECAY, ROTATION = 3.0, 15.0**0.5
"""Rates a and b of the rounding error's correlation, per quantisation step that the channel moves."""


@dataclass(frozen=True, eq=False)
class Rounding(CorrelatedNoise):
    """Rounding errors, correlated over the distance that a channel moves; `dwell` (N,) s is the time a step takes.

    Over a fraction s of a step an error's correlation is 1 − 6 s + 6 s², and over whole steps its mean is zero (Widrow,
    Kollár, Quantization Noise, 2008, §5). The velocity of a damped oscillator under white noise has zero mean too, and
    with a = 3, b = √15 its correlation e^−as (cos bs − a/b sin bs) agrees with that up to s².
    """

    dwell: Array
    share: float
    white: float

    def age(self, time: Array) -> Array:
        rate = DECAY / self.dwell
        return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])

    def correlation(self, apart: Array) -> Array:
        turned = ROTATION / DECAY * apart
        return np.asarray(np.exp(-apart) * (np.cos(turned) - DECAY / ROTATION * np.sin(turned)))

    def process(self, time: Array) -> NoiseProcess:
        phi = np.ascontiguousarray(np.moveaxis(_oscillation(np.diff(self.age(time))), 2, 0))
        return NoiseProcess.of(np.array([0.0, 1.0]), phi, np.diag([1.0 / (DECAY**2 + ROTATION**2), 1.0]))

    def drawn(self, rng: np.random.Generator, time: Array) -> Array:
        process = self.process(time)
        fresh, axes = np.linalg.eigh(process.fresh)
        pushes = np.einsum("nij,nj->ni", axes * np.sqrt(np.maximum(fresh, 0.0))[:, None], rng.normal(size=fresh.shape))
        start = np.sqrt(process.lasting) @ rng.normal(size=2)
        return np.asarray(_propagate(process.transition, start, pushes)[:, 1])


@compiled
def _propagate(steps: Array, start: Array, pushes: Array) -> Array:
    """States x (N + 1, 2) from x₀ = `start` (2,): xₖ₊₁ = Φₖ xₖ + wₖ with `steps` Φ (N, 2, 2) and `pushes` w (N, 2)."""
    states = np.empty((len(pushes) + 1, 2))
    states[0] = start
    for k in range(len(pushes)):
        for i in range(2):
            states[k + 1, i] = steps[k, i, 0] * states[k, 0] + steps[k, i, 1] * states[k, 1] + pushes[k, i]
    return states


def _oscillation(age: Array) -> Array:
    """Transition matrix Φ (2, 2, ...) of the oscillator's position and velocity over an age difference `age` (...,)."""
    fading, turned = np.exp(-age), ROTATION / DECAY * age
    cosine, sine = fading * np.cos(turned), fading * np.sin(turned)
    damped = DECAY / ROTATION * sine
    return np.array(
        [[cosine + damped, sine / ROTATION], [-(DECAY**2 + ROTATION**2) / ROTATION * sine, cosine - damped]]
    )


def quantum(values: Array) -> float | None:
    """The quantisation step of `values` (N,); None where they are not multiples of a step."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3:
        return None
    apart = np.diff(levels)
    step = float(apart.min())
    # repeated additions leave levels that differ by floating-point rounding only
    if step < 1e-9 * float(np.abs(levels).max()):
        return None
    times = apart / step
    return step if float(np.abs(times - np.round(times)).max()) < LATTICE_DEVIATION else None


def dwell(time: Array, values: Array, step: float) -> Array:
    """(N,) time, s, that a channel takes to move one `step` at its smoothed speed; at most the recording's duration."""
    seen = np.isfinite(values)
    times, values = time[seen], values[seen]
    stride = max(1, round(QUANTISED_WAY_INTERVAL / float(np.median(np.diff(times)))))
    count = len(values) // stride
    if count < 2:
        return np.zeros(len(time))
    middle, mean = (part[: count * stride].reshape(count, stride).mean(axis=1) for part in (times, values))
    speed = np.abs(np.diff(mean)) / np.diff(middle)
    slowest = step / float(times[-1] - times[0])
    return np.asarray(step / np.maximum(np.interp(time, 0.5 * (middle[1:] + middle[:-1]), speed), slowest))


def remembered(step: float, deviation: float) -> float:
    """Variance of the rounding error that stays correlated when white noise was added before rounding (dither).

    `deviation` is the total standard deviation of the noise, rounding included. The error is
    Σₖ (−1)ᵏ step/(πk) sin(2πk x/step); white noise of standard deviation w on x leaves a factor exp(−2 (πk w/step)²) of
    each wave's mean (Widrow, Kollár, 2008, §19).
    """
    white = max(deviation**2 - step**2 / 12.0, 0.0)
    waves = np.arange(1, 50)
    left = np.exp(-4.0 * np.pi**2 * waves**2 * white / step**2)
    return float(np.sum(step**2 / (2.0 * np.pi**2 * waves**2) * left))


def quantised_memories(recording: Recording, std: Mapping[str, float]) -> dict[str, Rounding]:
    """The rounding errors of each measured column of `recording` that stay correlated over several samples somewhere.

    An error that lasts longer than the windows enters the rows only where it changes, so only that fraction of its
    variance counts; an error that never changes is a bias. `std` is the standard deviation by column; columns with 0
    are exact and left out.
    """
    interval = float(np.median(np.diff(recording.time)))
    found: dict[str, Rounding] = {}
    for column, deviation in std.items():
        if deviation == 0.0:
            continue
        values = recording.measured(column)
        step = quantum(values)
        if step is None:
            continue
        lasting = dwell(recording.time, values, step)
        if lasting.max() > 6.0 * interval:
            rounded = min(1.0, remembered(step, deviation) / deviation**2)
            share = rounded * min(1.0, LONGEST_ROUNDING_DWELL * float(np.mean(1.0 / lasting)))
            found[column] = Rounding(np.minimum(lasting, LONGEST_ROUNDING_DWELL), share, 1.0 - rounded)
    return found
