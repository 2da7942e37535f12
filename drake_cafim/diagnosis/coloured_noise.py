"""Noise with a memory: as the scenario states it, or as the recordings show it where white noise was stated."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize_scalar
from scipy.signal import periodogram
from scipy.stats import chi2

from drake_cafim.contact.change import recursion
from drake_cafim.diagnosis.even_clock import evened
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

QUIET = 60.0
"""Hz, above which robots hardly move; there a channel holds its noise."""
SEGMENT = 128
SURE = 1e-6
"""Probability at which noise stated white is said not to be, per channel."""
LEVEL, FREE = 0.2, 20.0
"""Of the logarithm of the variance: as far as a stated one is trusted, and an estimated one."""
LONGEST = 0.05
"""s; of a longer memory the quiet frequencies show nothing but the slope."""
MEMORY = 8.0
"""Correlation times after which noise has forgotten: e⁻⁸ = 3·10⁻⁴."""
KEPT = 10_000_000
"""Entries of covariances that are kept, 120 MB."""
_COVARIANCES: dict[tuple[bytes, "Lasting"], sp.csr_matrix] = {}


class Lasting(ABC):
    """Noise of which a `share` of the variance lasts longer than a sample, and `white` does not."""

    share: float
    white: float

    @abstractmethod
    def age(self, time: Array) -> Array:
        """Samples at `time` (N,) s by how much is forgotten."""

    @abstractmethod
    def correlation(self, apart: Array) -> Array:
        """Of what lasts, at ages that are `apart`; at most e^−apart."""

    @abstractmethod
    def drawn(self, rng: np.random.Generator, time: Array) -> Array:
        """(N,) of what lasts at `time` (N,) s, of unit variance."""


@dataclass(frozen=True)
class Memory(Lasting):
    """Exponential correlation over `time` (s)."""

    time: float
    share: float = 1.0
    white: float = 0.0

    def age(self, time: Array) -> Array:
        return time / self.time

    def correlation(self, apart: Array) -> Array:
        return np.exp(-apart)

    def drawn(self, rng: np.random.Generator, time: Array) -> Array:
        kept = np.concatenate([[0.0], self.correlation(np.diff(self.age(time)))])
        fresh = np.sqrt(1.0 - kept**2) * rng.standard_normal(len(time))
        return recursion(kept, fresh[:, None])[:, 0]


def stated_memories(scene: Scene, columns: Sequence[str]) -> dict[str, Memory]:
    """The memory of each column whose `correlation_time` the scenario states."""
    times = {column: channel.correlation_time for column in columns if (channel := scene.channel(column)) is not None}
    return {column: Memory(time) for column, time in times.items() if time > 0.0}


def seen_memories(
    recordings: Sequence[Recording], std: Mapping[str, float], stated: Mapping[str, Memory], estimated: Set[str]
) -> tuple[dict[str, Memory], tuple[str, ...]]:
    """The memory of channels whose noise was not stated coloured but is, and a sentence for each kind.

    Above `QUIET` the spectrum of an exponentially correlated noise is σ² (1 − ρ²)/(1 − 2ρ cos ωh + ρ²),
    ρ = exp(−h/τ). Channels of a kind share τ: they come from like sensors. σ is `std`, free for `estimated` columns.
    """
    step = step_of(recordings)
    kinds: dict[str, list[str]] = {}
    for column, deviation in std.items():
        if deviation > 0.0 and column not in stated and not column.startswith("u."):
            kinds.setdefault(column.partition(".")[0], []).append(column)
    found: dict[str, Memory] = {}
    told = []
    for kind, columns in kinds.items():
        pieces = [
            _spectra(evened(one.time, one.measured(column)) / std[column], step)
            for one in recordings
            for column in columns
        ]
        phase, levels = pieces[0][0], np.concatenate([levels for _, levels in pieces])
        if len(levels) < 8 or len(phase) < 8:
            continue
        level = FREE if estimated & set(columns) else LEVEL
        memory, p_value = _memory(phase, levels, level, float(np.exp(-step / LONGEST)))
        if p_value < SURE and memory > 0.0:
            time = -step / float(np.log(memory))
            found |= dict.fromkeys(columns, Memory(time))
            told.append(f"the noise of {kind} is not white as stated: it has a correlation time of {1e3 * time:.2g} ms")
    return found, tuple(told)


def step_of(recordings: Sequence[Recording]) -> float:
    """The usual sampling time, s."""
    return float(np.median(np.concatenate([np.diff(one.time) for one in recordings])))


def widened(
    std: Mapping[str, float], memories: Mapping[str, Memory], estimated: Set[str], step: float
) -> dict[str, float]:
    """`std` with the `estimated` ones what fourth differences mean for noise of these `memories`."""
    differences = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    apart = np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
    wide = dict(std)
    for column in estimated & set(memories):
        seen = differences @ np.exp(-step * apart / memories[column].time) @ differences
        wide[column] *= float(np.sqrt(differences @ differences / seen))
    return wide


def covariance(time: Array, memory: Lasting) -> sp.csr_matrix:
    """(N, N) covariance of unit noise at `time`: of what lasts, and the white part on the diagonal. The last are kept.

    It is not to be changed.
    """
    key = time.tobytes(), memory
    if key not in _COVARIANCES:
        found = _covariance(time, memory)
        while _COVARIANCES and found.nnz + sum(one.nnz for one in _COVARIANCES.values()) > KEPT:
            make_room(_COVARIANCES, len(_COVARIANCES))
        _COVARIANCES[key] = found
    return _COVARIANCES[key]


def _covariance(time: Array, memory: Lasting) -> sp.csr_matrix:
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


def left_by(operator: sp.csr_matrix, time: Array, memory: Lasting | None) -> Array:
    """(N,) standard deviation of what `operator` (N, N) makes of unit noise at `time`; without a memory it is white."""
    return np.sqrt(np.maximum(_shared(_carried(operator, time, memory), operator), 0.0))


def apart_by(operators: Sequence[sp.csr_matrix], time: Array, memory: Lasting | None) -> Array:
    """(K, K, N) standard deviation of the difference of what each two of the K `operators` make of unit noise."""
    count = len(operators)
    shared = np.zeros((count, count, len(time)))
    for k, one in enumerate(operators):
        carried = _carried(one, time, memory)
        for other in range(k + 1):
            shared[k, other] = shared[other, k] = _shared(carried, operators[other])
    own = shared[np.arange(count), np.arange(count)]
    return np.sqrt(np.maximum(own[:, None] + own - 2.0 * shared, 0.0))


def _carried(operator: sp.csr_matrix, time: Array, memory: Lasting | None) -> sp.csr_matrix:
    return operator if memory is None else sp.csr_matrix(operator @ covariance(time, memory))


def _shared(carried: sp.csr_matrix, operator: sp.csr_matrix) -> Array:
    """(N,) covariance of what two operators make of noise, the one with its covariance already in it."""
    return np.asarray(carried.multiply(operator).sum(axis=1), dtype=float).ravel()


def drawn(rng: np.random.Generator, time: Array, memory: Lasting | None) -> Array:
    """(N,) unit noise at `time`; without a memory it is white."""
    if memory is None:
        return rng.standard_normal(len(time))
    white = rng.standard_normal(len(time)) if memory.white > 0.0 else np.zeros(len(time))
    return np.asarray(np.sqrt(memory.share) * memory.drawn(rng, time) + np.sqrt(memory.white) * white, dtype=float)


def _spectra(values: Array, step: float) -> tuple[Array, Array]:
    """Phases ωh (F,) above `QUIET`, and the power (S, F) of each stretch without a gap; 1 is unit white noise."""
    count = len(values) // SEGMENT
    pieces = values[: count * SEGMENT].reshape(count, SEGMENT)
    pieces = pieces[np.all(np.isfinite(pieces), axis=1)]
    # fourth differences keep the motion at low frequencies from leaking
    differences = np.diff(pieces, n=4, axis=1)
    if len(pieces):
        frequency, power = periodogram(differences, window="hann", detrend=False)
    else:
        # a recording shorter than a stretch has none
        frequency = np.fft.rfftfreq(differences.shape[1])
        power = np.zeros((0, len(frequency)))
    phase = 2.0 * np.pi * frequency
    lowest = min(2.0 * np.pi * QUIET * step, 0.4 * np.pi)
    used = (phase > lowest) & (phase < 0.95 * np.pi)
    gain = (2.0 - 2.0 * np.cos(phase[used])) ** 4
    # one-sided and per hertz of a unit sampling rate: white noise of variance 1 has 2
    return phase[used], 0.5 * power[:, used] / gain


def _memory(phase: Array, levels: Array, level: float, longest: float) -> tuple[float, float]:
    """ρ of the noise, at most `longest`, and the p-value of zero; the variance's logarithm is known to `level`."""
    # the median over the stretches does not see the few in which something snapped
    seen = np.log(np.median(levels, axis=0) / np.log(2.0))
    variance = 2.1 / len(levels)

    def misfit(memory: float) -> float:
        expected = np.log((1.0 - memory**2) / (1.0 - 2.0 * memory * np.cos(phase) + memory**2))
        left = seen - expected
        return float(np.sum((left - np.clip(left.mean(), -level, level)) ** 2)) / variance

    best = minimize_scalar(misfit, bounds=(0.0, longest), method="bounded")
    # Hann's window makes neighbouring frequencies depend on each other: half as many count
    left, count = 0.5 * float(best.fun), 0.5 * len(phase)
    if chi2.sf(left, count) < SURE:
        # a spectrum of another shape, such as that of a filter, is not for this law to describe
        return 0.0, 1.0
    gained = (0.5 * misfit(0.0) - left) / max(1.0, left / count)
    return float(best.x), float(chi2.sf(max(gained, 0.0), 1))
