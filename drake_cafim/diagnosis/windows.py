"""Smooth test functions over a recording: the weak form's integrals as sparse matrices.

A measurement is never differentiated: with w(t) = sin⁴(π (t − t₀)/T) on [t₀, t₀ + T], zero outside, the derivative
of a momentum p moves onto w, ∫ w ṗ dt = −∫ ẇ p dt. w, ẇ and ẅ vanish at both ends, so the trapezoid rule is
accurate far beyond its order for smooth integrands (Euler–Maclaurin); kinks at the steps of a held effort are
corrected for exactly to fourth order in the sampling time.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from drake_cafim.typing import Array

Indices: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True)
class Windows:
    """M half-overlapping test functions over samples at `time` (N,) s.

    `starts` (M,) s and `width` s; `first` and `stop` (M,) are the samples that each one covers.
    """

    time: Array
    starts: Array
    width: float
    first: Indices
    stop: Indices

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def centers(self) -> Array:
        return self.starts + 0.5 * self.width

    @cached_property
    def value(self) -> sp.csr_matrix:
        """(M, N): `value @ f` is ∫ w f dt."""
        phase, rows, columns = self._phases
        return self._matrix(np.sin(phase) ** 4 * self._trapezoid[columns], rows, columns)

    @cached_property
    def rate(self) -> sp.csr_matrix:
        """(M, N): `rate @ f` is ∫ ẇ f dt."""
        phase, rows, columns = self._phases
        slope = 4.0 * np.pi / self.width * np.sin(phase) ** 3 * np.cos(phase)
        return self._matrix(slope * self._trapezoid[columns], rows, columns)

    @cached_property
    def rate_steps(self) -> sp.csr_matrix:
        """(M, N): the h²/12 correction to `value @ v` for accelerations (N,) held from sample to sample.

        The trapezoid rule errs by h²/12 Σ (w_{i+1} − w_i) a_i where the slope of v jumps at the samples.
        """
        steps = np.diff(self.time)
        difference = sp.diags_array(
            [-np.ones(len(steps)), np.ones(len(steps))], offsets=[0, 1], shape=(len(steps), len(self.time))
        )
        held = sp.csr_matrix(self._pointwise @ difference.T @ sp.diags_array(steps**2 / 12.0))
        return sp.csr_matrix(sp.hstack([held, sp.csr_matrix((len(self), 1))]))

    def held(self, times: Array) -> sp.csr_matrix:
        """(M, K): `held @ u` is ∫ w u dt for u held from each of `times` (K,) to the next.

        Contains what the trapezoid rule of `rate` misses because the momentum has a kink wherever u steps: a step
        Δu at the fraction x of a sampling interval h adds (h²/2 B₂(x) ẇ − h³/3 B₃(x) ẅ) Δu, with the Bernoulli
        polynomials B₂ = x² − x + 1/6 and B₃ = x³ − 3x²/2 + x/2 (Euler–Maclaurin with the jumps of (ẇ p)′, (ẇ p)″).
        """
        clipped = np.clip(times, self.time[0], self.time[-1])
        ends = np.append(clipped[1:], self.time[-1])
        first = np.searchsorted(times, self.starts, side="right") - 1
        stop = np.searchsorted(times, self.starts + self.width, side="left")
        first = np.clip(first, 0, None)
        counts = np.maximum(stop - first, 0)
        rows = np.repeat(np.arange(len(self)), counts)
        columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
        origin = self.starts[rows]
        weights = self._antiderivative(ends[columns] - origin) - self._antiderivative(clipped[columns] - origin)
        interval = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        h = np.diff(self.time)[interval]
        x = (times - self.time[interval]) / h
        second = 0.5 * h**2 * (x**2 - x + 1.0 / 6.0)
        third = h**3 / 3.0 * (x**3 - 1.5 * x**2 + 0.5 * x)
        since = clipped[columns] - origin
        at_step = self._slope(since) * second[columns] - self._curvature(since) * third[columns]
        integral = self._matrix(weights, rows, columns, len(times))
        jumps = self._matrix(at_step, rows, columns, len(times))
        step = sp.diags_array([np.ones(len(times)), -np.ones(len(times) - 1)], offsets=[0, -1])
        return sp.csr_matrix(integral + jumps @ step)

    def rows(self, per_window: Array) -> Array:
        """Flatten (M, r, ...) to (M r, ...), window after window."""
        return per_window.reshape(-1, *per_window.shape[2:])

    @cached_property
    def _trapezoid(self) -> Array:
        steps = np.diff(self.time)
        return 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))

    @cached_property
    def _phases(self) -> tuple[Array, Indices, Indices]:
        counts = self.stop - self.first
        rows = np.repeat(np.arange(len(self)), counts)
        offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        columns = offset + np.repeat(self.first, counts)
        return np.pi * (self.time[columns] - self.starts[rows]) / self.width, rows, columns

    @cached_property
    def _pointwise(self) -> sp.csr_matrix:
        phase, rows, columns = self._phases
        return self._matrix(np.sin(phase) ** 4, rows, columns)

    def _matrix(self, values: Array, rows: Indices, columns: Indices, width: int | None = None) -> sp.csr_matrix:
        return sp.csr_matrix((values, (rows, columns)), shape=(len(self), width or len(self.time)))

    def _slope(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        return np.asarray(4.0 * np.pi / self.width * np.sin(phase) ** 3 * np.cos(phase), dtype=float)

    def _curvature(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        sine, cosine = np.sin(phase), np.cos(phase)
        return np.asarray(4.0 * (np.pi / self.width) ** 2 * sine**2 * (3.0 * cosine**2 - sine**2), dtype=float)

    def _antiderivative(self, since: Array) -> Array:
        """∫₀ˢ sin⁴(π t/T) dt = T/π (3x/8 − sin 2x/4 + sin 4x/32), x = π s/T."""
        x = np.pi * np.clip(since, 0.0, self.width) / self.width
        antiderivative = self.width / np.pi * (0.375 * x - 0.25 * np.sin(2.0 * x) + np.sin(4.0 * x) / 32.0)
        return np.asarray(antiderivative, dtype=float)


def lay_windows(time: Array, usable: np.ndarray[Any, np.dtype[np.bool_]], width: float) -> Windows:
    """Half-overlapping windows of `width` s that lie within runs of usable samples.

    `usable` (N,) marks the samples at which all that is needed was measured. A run also ends where the next sample
    is more than 2.5 median sampling times away.
    """
    steps = np.diff(time)
    breaks = ~usable[1:] | ~usable[:-1] | (steps > 2.5 * np.median(steps))
    edges = np.flatnonzero(breaks)
    begins, ends = np.append(0, edges + 1), np.append(edges, len(time) - 1)
    starts: list[float] = []
    for begin, end in zip(begins, ends, strict=True):
        count = int((time[end] - time[begin] - width) / (0.5 * width) + 1e-9) + 1
        starts.extend(time[begin] + 0.5 * width * np.arange(max(count, 0)))
    origin = np.array(starts, dtype=float)
    # a sample that lies on a window's end has weight zero there: it is left to the next one
    first = np.searchsorted(time, origin - 1e-12, side="left")
    stop = np.searchsorted(time, origin + width + 1e-12, side="right")
    return Windows(time, origin, width, first, stop)
