"""Noise that is correlated in time: as the scenario states it, or as estimated from the recordings' spectra."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize_scalar
from scipy.signal import periodogram
from scipy.stats import chi2

from drake_cafim.contact.change import recursion
from drake_cafim.diagnosis.noise.clock import remove_clock_jitter
from drake_cafim.diagnosis.thresholds import (
    COLOURED_NOISE_P_VALUE,
    ESTIMATED_NOISE_LOG_VARIANCE_REACH,
    LONGEST_CORRELATION_TIME,
    QUIET_FREQUENCY,
    SPECTRUM_SEGMENT_SAMPLES,
    STATED_NOISE_LOG_VARIANCE_REACH,
)
from drake_cafim.numerics.cache import make_room
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MEMORY = 8.0
"""Correlation times beyond which the correlation counts as zero: e⁻⁸ = 3·10⁻⁴."""
CACHED_ENTRIES = 10_000_000
"""Most entries of all cached covariances together, 120 MB."""
_COVARIANCES: dict[tuple[bytes, "CorrelatedNoise"], sp.csr_matrix] = {}


@dataclass(frozen=True)
class NoiseProcess:
    """Noise of unit variance as a linear system of p states x that white noise drives: `output` (p,) times x.

    From sample to sample x is multiplied by `transition` (N − 1, p, p), and noise of covariance `fresh` (N − 1, p, p)
    is added, so that the covariance `lasting` (p, p) stays.
    """

    output: Array
    transition: Array
    fresh: Array
    lasting: Array

    @classmethod
    def of(cls, output: Array, transition: Array, lasting: Array) -> "NoiseProcess":
        """That in which `lasting` stays the covariance."""
        fresh = lasting - transition @ lasting @ np.swapaxes(transition, 1, 2)
        return cls(output, transition, fresh, lasting)

    @property
    def states(self) -> int:
        """The number p of states."""
        return len(self.output)


class CorrelatedNoise(ABC):
    """Noise of unit variance: a fraction `share` is correlated in time, a fraction `white` is white."""

    share: float
    white: float

    @abstractmethod
    def age(self, time: Array) -> Array:
        """(N,) dimensionless times of the samples at `time` (N,) s, in units of the local correlation time."""

    @abstractmethod
    def correlation(self, apart: Array) -> Array:
        """Autocorrelation of the correlated part at a difference `apart` of ages; at most e^−apart."""

    @abstractmethod
    def process(self, time: Array) -> NoiseProcess:
        """The linear system whose output is the correlated part, of unit variance, at `time` (N,) s."""

    @abstractmethod
    def drawn(self, rng: np.random.Generator, time: Array) -> Array:
        """One random realisation (N,) of the correlated part at `time` (N,) s, of unit variance."""


@dataclass(frozen=True)
class Memory(CorrelatedNoise):
    """Exponentially correlated noise (Ornstein–Uhlenbeck process) with the correlation time `time` (s)."""

    time: float
    share: float = 1.0
    white: float = 0.0

    def age(self, time: Array) -> Array:
        return time / self.time

    def correlation(self, apart: Array) -> Array:
        return np.exp(-apart)

    def process(self, time: Array) -> NoiseProcess:
        decay = self.correlation(np.diff(self.age(time)))
        return NoiseProcess.of(np.ones(1), decay[:, None, None], np.ones((1, 1)))

    def drawn(self, rng: np.random.Generator, time: Array) -> Array:
        decay = np.concatenate([[0.0], self.correlation(np.diff(self.age(time)))])
        innovation = np.sqrt(1.0 - decay**2) * rng.standard_normal(len(time))
        return recursion(decay, innovation[:, None])[:, 0]


def stated_memories(scene: Scene, columns: Sequence[str]) -> dict[str, Memory]:
    """The correlation model of each of `columns` whose `correlation_time` the scenario states as positive."""
    times = {column: channel.correlation_time for column in columns if (channel := scene.channel(column)) is not None}
    return {column: Memory(time) for column, time in times.items() if time > 0.0}


def estimate_memories(
    recordings: Sequence[Recording], std: Mapping[str, float], stated: Mapping[str, Memory], estimated: Set[str]
) -> tuple[dict[str, Memory], tuple[str, ...]]:
    """Correlation models of columns whose noise is coloured though stated white, and a note for each kind of channel.

    Above `QUIET_FREQUENCY`, where the motion has little power, the spectrum of an exponentially correlated noise is
    σ² (1 − ρ²)/(1 − 2ρ cos ωh + ρ²) with ρ = exp(−h/τ) at the sampling time h. τ is fitted once for each kind of
    channel (q, v, ...), whose sensors are alike. σ is `std`, within a wide bound for `estimated` columns and a narrow
    one for others. Channels of effort are left out: their spectrum holds what the controller does.
    """
    step = step_of(recordings)
    kinds: dict[str, list[str]] = {}
    for column, deviation in std.items():
        if deviation > 0.0 and column not in stated and not column.startswith("u."):
            kinds.setdefault(column.partition(".")[0], []).append(column)
    found: dict[str, Memory] = {}
    notes = []
    for kind, columns in kinds.items():
        pieces = [
            _spectra(remove_clock_jitter(recording.time, recording.measured(column)) / std[column], step)
            for recording in recordings
            for column in columns
        ]
        phase, levels = pieces[0][0], np.concatenate([levels for _, levels in pieces])
        if len(levels) < 8 or len(phase) < 8:
            continue
        level = ESTIMATED_NOISE_LOG_VARIANCE_REACH if estimated & set(columns) else STATED_NOISE_LOG_VARIANCE_REACH
        memory, p_value = _memory(phase, levels, level, float(np.exp(-step / LONGEST_CORRELATION_TIME)))
        if p_value < COLOURED_NOISE_P_VALUE and memory > 0.0:
            time = -step / float(np.log(memory))
            found |= dict.fromkeys(columns, Memory(time))
            notes.append(f"the noise of {kind} is not white: its correlation time is {1e3 * time:.2g} ms")
    return found, tuple(notes)


def step_of(recordings: Sequence[Recording]) -> float:
    """The median sampling time of all recordings, s."""
    return float(np.median(np.concatenate([np.diff(recording.time) for recording in recordings])))


def covariance(time: Array, memory: CorrelatedNoise) -> sp.csr_matrix:
    """(N, N) covariance of unit noise at `time` (N,) s: the correlated part, plus the white part on the diagonal.

    Cached; the caller must not change the matrix.
    """
    key = time.tobytes(), memory
    if key not in _COVARIANCES:
        found = _covariance(time, memory)
        while _COVARIANCES and found.nnz + sum(cached.nnz for cached in _COVARIANCES.values()) > CACHED_ENTRIES:
            make_room(_COVARIANCES, len(_COVARIANCES))
        _COVARIANCES[key] = found
    return _COVARIANCES[key]


def _covariance(time: Array, memory: CorrelatedNoise) -> sp.csr_matrix:
    age = memory.age(time)
    diagonals, offsets = [np.full(len(time), memory.share + memory.white)], [0]
    for offset in range(1, len(time)):
        apart = age[offset:] - age[:-offset]
        if apart.min() > MEMORY:
            break
        near = np.where(apart > MEMORY, 0.0, memory.share * memory.correlation(apart))
        diagonals += [near, near]
        offsets += [offset, -offset]
    result = sp.csr_matrix(sp.diags_array(diagonals, offsets=offsets))
    result.eliminate_zeros()
    return result


def filtered_std(operator: sp.csr_matrix, time: Array, memory: CorrelatedNoise | None) -> Array:
    """(N,) standard deviation of `operator` (N, N) applied to unit noise at `time`, white if `memory` is None.

    √diag(A C Aᵀ) for the operator A and the noise's covariance C.
    """
    return np.sqrt(np.maximum(_cross_covariance(_correlate(operator, time, memory), operator), 0.0))


def difference_std(operators: Sequence[sp.csr_matrix], time: Array, memory: CorrelatedNoise | None) -> Array:
    """(K, K, N) standard deviation of the difference of each two of the K `operators` (N, N), applied to unit noise.

    √diag((A − B) C (A − B)ᵀ) for each pair A, B and the noise's covariance C.
    """
    count = len(operators)
    shared = np.zeros((count, count, len(time)))
    for k, operator in enumerate(operators):
        correlated = _correlate(operator, time, memory)
        for m in range(k + 1):
            shared[k, m] = shared[m, k] = _cross_covariance(correlated, operators[m])
    variance = shared[np.arange(count), np.arange(count)]
    return np.sqrt(np.maximum(variance[:, None] + variance - 2.0 * shared, 0.0))


def _correlate(operator: sp.csr_matrix, time: Array, memory: CorrelatedNoise | None) -> sp.csr_matrix:
    """`operator` times the covariance of unit noise, (N, N)."""
    return operator if memory is None else sp.csr_matrix(operator @ covariance(time, memory))


def _cross_covariance(correlated: sp.csr_matrix, operator: sp.csr_matrix) -> Array:
    """(N,) diag(A C Bᵀ) for `correlated` = A C (N, N), an operator times the noise's covariance, and `operator` = B."""
    return np.asarray(correlated.multiply(operator).sum(axis=1), dtype=float).ravel()


def drawn(rng: np.random.Generator, time: Array, memory: CorrelatedNoise | None) -> Array:
    """One random realisation (N,) of unit noise at `time` (N,) s; white if `memory` is None."""
    if memory is None:
        return rng.standard_normal(len(time))
    white = rng.standard_normal(len(time)) if memory.white > 0.0 else np.zeros(len(time))
    return np.asarray(np.sqrt(memory.share) * memory.drawn(rng, time) + np.sqrt(memory.white) * white, dtype=float)


def _spectra(values: Array, step: float) -> tuple[Array, Array]:
    """Phases ωh (F,) above `QUIET_FREQUENCY`, and the periodogram (S, F) of each of S segments without a gap.

    Normalised: white noise of unit variance has power 1.
    """
    count = len(values) // SPECTRUM_SEGMENT_SAMPLES
    pieces = values[: count * SPECTRUM_SEGMENT_SAMPLES].reshape(count, SPECTRUM_SEGMENT_SAMPLES)
    pieces = pieces[np.all(np.isfinite(pieces), axis=1)]
    # fourth differences keep the motion at low frequencies from leaking
    differences = np.diff(pieces, n=4, axis=1)
    if len(pieces):
        frequency, power = periodogram(differences, window="hann", detrend=False)
    else:
        # a recording shorter than a segment has none
        frequency = np.fft.rfftfreq(differences.shape[1])
        power = np.zeros((0, len(frequency)))
    phase = 2.0 * np.pi * frequency
    lowest = min(2.0 * np.pi * QUIET_FREQUENCY * step, 0.4 * np.pi)
    used = (phase > lowest) & (phase < 0.95 * np.pi)
    gain = (2.0 - 2.0 * np.cos(phase[used])) ** 4
    # one-sided and per hertz of a unit sampling rate: white noise of variance 1 has 2
    return phase[used], 0.5 * power[:, used] / gain


def _memory(phase: Array, levels: Array, level: float, longest: float) -> tuple[float, float]:
    """ρ of the noise, at most `longest`, and the p-value of ρ = 0 by the likelihood ratio.

    `levels` (S, F) are the spectra at `phase` (F,); the variance's logarithm may be off by `level`.
    """
    # the median over the segments is robust against the few that hold an impact; of χ²₂ power it is ln 2 of the mean
    usual = np.median(levels, axis=0) / np.log(2.0)
    if not np.all(usual > 0.0):
        # a column that does not change has no noise, and so none that lasts
        return 0.0, 1.0
    seen = np.log(usual)
    variance = 2.1 / len(levels)

    def misfit(memory: float) -> float:
        expected = np.log((1.0 - memory**2) / (1.0 - 2.0 * memory * np.cos(phase) + memory**2))
        left = seen - expected
        return float(np.sum((left - np.clip(left.mean(), -level, level)) ** 2)) / variance

    best = minimize_scalar(misfit, bounds=(0.0, longest), method="bounded")
    # Hann's window correlates neighbouring frequencies: only half of them count as independent
    left, count = 0.5 * float(best.fun), 0.5 * len(phase)
    if chi2.sf(left, count) < COLOURED_NOISE_P_VALUE:
        # a spectrum of another shape, such as that of a filter, is not described by this model
        return 0.0, 1.0
    gained = (0.5 * misfit(0.0) - left) / max(1.0, left / count)  # of χ² by ρ, scaled by the misfit that remains
    return float(best.x), float(chi2.sf(max(gained, 0.0), 1))
