"""Quantisation noise: not white where a channel moves by about a whole number of steps, or none, between samples."""

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
COHERENT_SAMPLES = 6
"""Samples within which a channel must seem to stay within one step somewhere, for its rounding errors not to count as
white."""
MOST_SKIPPED = 4
"""Most steps from one sample to the next of a channel that never moves by a single one."""
LEAST_ROUNDED_SHARE = 0.01
"""Share of the noise's variance by rounding errors below which they count as white: dither hides them."""


@dataclass(frozen=True, eq=False)
class Rounding(CorrelatedNoise):
    """Rounding errors to multiples of `step`, correlated over the distance that a channel moves; see `dwell` (N,) s.

    Over a fraction s of a step an error's correlation is 1 − 6 s + 6 s², and over whole steps its mean is zero (Widrow,
    Kollár, Quantization Noise, 2008, §5). The velocity of a damped oscillator under white noise has zero mean too, and
    with a = 3, b = √15 its correlation e^−as (cos bs − a/b sin bs) agrees with that up to s².
    """

    dwell: Array
    share: float
    white: float
    step: float

    def age(self, time: Array) -> Array:
        rate = DECAY / self.dwell
        return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])

    def correlation(self, apart: Array) -> Array:
        turned = ROTATION / DECAY * apart
        return np.asarray(np.exp(-apart) * (np.cos(turned) - DECAY / ROTATION * np.sin(turned)))

    def process(self, time: Array) -> NoiseProcess:
        phi = np.ascontiguousarray(np.moveaxis(_oscillation(np.diff(self.age(time))), 2, 0))
        return NoiseProcess.of(np.array([0.0, 1.0]), phi, np.diag([1.0 / (DECAY**2 + ROTATION**2), 1.0]))

    def of_readings(self, rng: np.random.Generator, values: Array, std: float, count: int) -> Array:
        """(N, count) errors of readings of a channel that moves like `values` (N,), anywhere beside the lattice.

        Before it is rounded, white noise is added that makes the errors' standard deviation `std`.
        """
        white = np.sqrt(max(std**2 - self.step**2 / 12.0, 0.0))
        true = values[:, None] + self.step * rng.uniform(size=count)
        read = self.step * np.round((true + white * rng.standard_normal(true.shape)) / self.step)
        return np.asarray(read - true)

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
    """The quantisation step of `values` (N,); None where they are not multiples of a step.

    A fast channel may skip levels: then the smallest difference is a multiple of the step.
    """
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3:
        return None
    apart = np.diff(levels)
    least = float(apart.min())
    # repeated additions leave levels that differ by floating-point rounding only
    if least < 1e-9 * float(np.abs(levels).max()):
        return None
    for skipped in range(1, MOST_SKIPPED + 1):
        times = skipped * apart / least
        if float(np.abs(times - np.round(times)).max()) < LATTICE_DEVIATION:
            return least / skipped
    return None


def dwell(time: Array, values: Array, step: float) -> Array:
    """(N,) time, s, in which a channel seems to move one `step`, as its samples show; at most the recording's duration.

    An error is the same a whole step further: moving by m steps from one sample to the next, as an encoder at constant
    speed may for seconds, looks like moving by what m is away from an integer. m is taken from the smoothed speed.
    """
    seen = np.isfinite(values)
    times, values = time[seen], values[seen]
    stride = max(1, round(QUANTISED_WAY_INTERVAL / float(np.median(np.diff(times)))))
    count = len(values) // stride
    if count < 2:
        return np.zeros(len(time))
    middle, mean = (part[: count * stride].reshape(count, stride).mean(axis=1) for part in (times, values))
    speed, interval = np.diff(mean) / np.diff(middle), np.gradient(time)
    moved = np.interp(time, 0.5 * (middle[1:] + middle[:-1]), speed) * interval / step
    apparent = np.abs(moved - np.round(moved))
    return np.asarray(interval / np.maximum(apparent, interval / float(times[-1] - times[0])))


def is_coherent(time: Array, lasting: Array) -> bool:
    """Whether rounding errors that last for `lasting` (N,) s stay correlated over several samples somewhere."""
    apparent = np.gradient(time) / np.maximum(lasting, np.finfo(float).tiny)
    return bool(np.convolve(apparent, np.ones(COHERENT_SAMPLES), "valid").min() < 1.0)


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
    found: dict[str, Rounding] = {}
    for column, deviation in std.items():
        if deviation == 0.0:
            continue
        values = recording.measured(column)
        step = quantum(values)
        if step is None:
            continue
        rounded = min(1.0, remembered(step, deviation) / deviation**2)
        lasting = dwell(recording.time, values, step)
        if rounded > LEAST_ROUNDED_SHARE and is_coherent(recording.time, lasting):
            share = rounded * min(1.0, LONGEST_ROUNDING_DWELL * float(np.mean(1.0 / lasting)))
            found[column] = Rounding(np.minimum(lasting, LONGEST_ROUNDING_DWELL), share, 1.0 - rounded, step)
    return found
