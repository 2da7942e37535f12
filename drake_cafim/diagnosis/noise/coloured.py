"""Noise that is correlated in time: as the scenario states it, or as estimated from the recordings' spectra."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from drake_cafim.contact.change import recursion
from drake_cafim.diagnosis.noise.clock import remove_clock_jitter
from drake_cafim.diagnosis.noise.spectra import first_order_memory
from drake_cafim.diagnosis.thresholds import (
    ESTIMATED_NOISE_LOG_VARIANCE_REACH,
    LONGEST_CORRELATION_TIME,
    STATED_NOISE_LOG_VARIANCE_REACH,
)
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.local_polynomial import CACHED_SAMPLES
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MEMORY = 8.0
"""Correlation times beyond which the correlation counts as zero: e⁻⁸ = 3·10⁻⁴."""
CACHED_ENTRIES = 10_000_000
"""Most entries of all cached covariances together, 120 MB."""
ROWS_AT_ONCE = 1_000
"""Rows of an operator that are multiplied by a covariance at a time, to limit memory."""
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

    The spectrum of an exponentially correlated noise is σ² (1 − ρ²)/(1 − 2ρ cos ωh + ρ²) with ρ = exp(−h/τ) at the
    sampling time h. τ is fitted once for each kind of channel (q, v, ...), whose sensors are alike, see
    `first_order_memory`. σ is `std`, within a wide bound for `estimated` columns and a narrow one for others. Channels
    of effort are left out: their spectrum holds what the controller does.
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
            remove_clock_jitter(recording.time, recording.measured(column)) / std[column]
            for recording in recordings
            for column in columns
        ]
        level = ESTIMATED_NOISE_LOG_VARIANCE_REACH if estimated & set(columns) else STATED_NOISE_LOG_VARIANCE_REACH
        memory = first_order_memory(pieces, step, level, float(np.exp(-step / LONGEST_CORRELATION_TIME)))
        if memory > 0.0:
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
        found = _covariance(memory.age(time), memory)
        while _COVARIANCES and found.nnz + sum(cached.nnz for cached in _COVARIANCES.values()) > CACHED_ENTRIES:
            make_room(_COVARIANCES, len(_COVARIANCES))
        _COVARIANCES[key] = found
    return _COVARIANCES[key]


def _covariance(age: Array, memory: CorrelatedNoise) -> sp.csr_matrix:
    """(N, N) covariance of unit noise at samples of the `age` (N,), see `CorrelatedNoise.age`."""
    diagonals, offsets = [np.full(len(age), memory.share + memory.white)], [0]
    for offset in range(1, len(age)):
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
    """(R,) standard deviation of `operator` (R, N) applied to unit noise at `time`, white if `memory` is None.

    √diag(A C Aᵀ) for the operator A and the noise's covariance C.
    """
    if memory is None:
        squares = sp.csr_matrix((operator.data**2, operator.indices, operator.indptr), operator.shape)
        variance = np.ravel(squares.sum(axis=1))
    else:
        variance = _shared_variance([operator], time, memory)[0, 0]
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=float)


def difference_std(operators: Sequence[sp.csr_matrix], time: Array, memory: CorrelatedNoise | None) -> Array:
    """(K, K, N) standard deviation of the difference of each two of the K `operators` (N, N), applied to unit noise.

    √diag((A − B) C (A − B)ᵀ) for each pair A, B and the noise's covariance C.
    """
    every = np.arange(len(operators))
    shared = _shared_variance(operators, time, memory)
    variance = shared[every, every]
    return np.asarray(np.sqrt(np.maximum(variance[:, None] + variance - 2.0 * shared, 0.0)), dtype=float)


def _shared_variance(operators: Sequence[sp.csr_matrix], time: Array, memory: CorrelatedNoise | None) -> Array:
    """(K, K, R) diag(A C Bᵀ) for each two of the K `operators` (R, N) A, B and the covariance C of unit noise.

    A few rows at a time: A C of a minute at 1 kHz takes gigabytes.
    """
    N, R, K = len(time), operators[0].shape[0], len(operators)
    shared = np.zeros((K, K, R))
    age = None if memory is None or N <= CACHED_SAMPLES else memory.age(time)
    for begin in range(0, R, ROWS_AT_ONCE):
        own = slice(begin, min(begin + ROWS_AT_ONCE, R))
        parts = [operator[own] for operator in operators]
        correlated = parts
        if memory is not None:
            indices = np.concatenate([part.indices for part in parts])
            near = slice(int(indices.min(initial=N - 1)), int(indices.max(initial=0)) + 1)
            alike = covariance(time, memory)[near, near] if age is None else _covariance(age[near], memory)
            parts = [part[:, near] for part in parts]
            correlated = [sp.csr_matrix(part @ alike) for part in parts]
        for k, rows in enumerate(correlated):
            for m in range(k + 1):
                shared[k, m, own] = shared[m, k, own] = np.ravel(rows.multiply(parts[m]).sum(axis=1))
    return shared


def drawn(rng: np.random.Generator, time: Array, memory: CorrelatedNoise | None) -> Array:
    """One random realisation (N,) of unit noise at `time` (N,) s; white if `memory` is None."""
    if memory is None:
        return rng.standard_normal(len(time))
    white = rng.standard_normal(len(time)) if memory.white > 0.0 else np.zeros(len(time))
    return np.asarray(np.sqrt(memory.share) * memory.drawn(rng, time) + np.sqrt(memory.white) * white, dtype=float)
