"""Smooth test functions over a recording: the weak form's integrals as sparse matrices.

A measurement is never differentiated: with w(t) = sin⁴(π (t − t₀)/T) on [t₀, t₀ + T], zero outside, the derivative
of a momentum p moves onto w, ∫ w ṗ dt = −∫ ẇ p dt. Between samples, on whatever grid, the integrand's other factor is
taken as a cubic and w as it is; what that misses where a held effort steps is corrected for.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.quadrature import NODES, gauss, lagrange, missed_kink
from drake_cafim.typing import Array, Indices


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
    _held: dict[bytes, sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)
    _steps: dict[bytes, sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)
    _kinks: dict[bytes, Array] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def centers(self) -> Array:
        return self.starts + 0.5 * self.width

    @cached_property
    def value(self) -> sp.csr_matrix:
        """(M, N): `value @ f` is ∫ w f dt."""
        return self._product(self._weight)

    @cached_property
    def rate(self) -> sp.csr_matrix:
        """(M, N): `rate @ f` is ∫ ẇ f dt."""
        return self._product(self._slope)

    def steps(self, times: Array) -> sp.csr_matrix:
        """(M, K): the correction to `rate @ q + value @ v` for accelerations held from each of `times` (K,) on.

        The cubics between the samples miss what a jump of the slope of v and of the curvature of q adds. The last few
        are kept.
        """
        return self._kept(self._steps, times, self._correction_of_steps)

    def _correction_of_steps(self, times: Array) -> sp.csr_matrix:
        clipped, rows, columns = self._reached(times)
        since = clipped[columns] - self.starts[rows]
        slope, curvature = self._kink(clipped), missed_kink(self.time, clipped, order=2)
        area, moment = slope[0, columns], slope[1, columns] + curvature[0, columns]
        jumps = self._weight(since) * area + self._slope(since) * moment
        return sp.csr_matrix(-self._matrix(jumps, rows, columns, len(times)) @ _jump(len(times)))

    def held(self, times: Array) -> sp.csr_matrix:
        """(M, K): `held @ u` is ∫ w u dt for u held from each of `times` (K,) to the next; the last few are kept.

        Contains what `rate` misses because the slope of the momentum jumps by Δu wherever u steps.
        """
        return self._kept(self._held, times, self._integral_of_held)

    def _kink(self, times: Array) -> Array:
        """What is missed of a slope that jumps at `times` (K,), (3, K); the last one is kept for the other integral."""
        key = times.tobytes()
        if key not in self._kinks:
            make_room(self._kinks, 1)
            self._kinks[key] = missed_kink(self.time, times)
        return self._kinks[key]

    def _kept(
        self, known: dict[bytes, sp.csr_matrix], times: Array, made: Callable[[Array], sp.csr_matrix]
    ) -> sp.csr_matrix:
        key = times.tobytes()
        if key not in known:
            make_room(known, 12)
            known[key] = made(times)
        return known[key]

    def _reached(self, times: Array) -> tuple[Array, Indices, Indices]:
        """`times` (K,) s within the recording, and window and time of every pair that may meet."""
        clipped = np.clip(times, self.time[0], self.time[-1])
        first = np.searchsorted(times, self.starts, side="right") - 1
        stop = np.searchsorted(times, self.starts + self.width, side="left")
        first = np.clip(first, 0, None)
        counts = np.maximum(stop - first, 0)
        rows = np.repeat(np.arange(len(self)), counts)
        columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
        return clipped, rows, columns

    def _integral_of_held(self, times: Array) -> sp.csr_matrix:
        clipped, rows, columns = self._reached(times)
        ends = np.append(clipped[1:], self.time[-1])
        origin = self.starts[rows]
        weights = self._antiderivative(ends[columns] - origin) - self._antiderivative(clipped[columns] - origin)
        missed = self._kink(clipped)[:, columns]
        since = clipped[columns] - origin
        weights_there = (self._slope(since), self._curvature(since), self._jerk(since))
        at_step = sum(weight * moment for weight, moment in zip(weights_there, missed, strict=True))
        integral = self._matrix(weights, rows, columns, len(times))
        return sp.csr_matrix(integral + self._matrix(at_step, rows, columns, len(times)) @ _jump(len(times)))

    def rows(self, per_window: Array) -> Array:
        """Flatten (M, r, ...) to (M r, ...), window after window."""
        return per_window.reshape(-1, *per_window.shape[2:])

    def _product(self, weight: Callable[[Array], Array]) -> sp.csr_matrix:
        """(M, N): ∫ weight(t − t₀) f dt with f cubic between the samples, of which only the window's own are used."""
        counts = self.stop - self.first
        rows = np.repeat(np.arange(len(self)), counts + 1)
        place = np.arange(len(rows)) - np.repeat(np.cumsum(counts + 1) - counts - 1, counts + 1)
        # a window starts a little before its first sample and ends a little after its last
        right = self.first[rows] + place
        lower = np.where(place == 0, self.starts[rows], self.time[np.maximum(right - 1, 0)])
        last = np.minimum(right, len(self.time) - 1)
        upper = np.where(place == counts[rows], self.starts[rows] + self.width, self.time[last])
        nodes = np.clip(right - 2, self.first[rows], self.stop[rows] - NODES)[:, None] + np.arange(NODES)
        t, measure = gauss(lower, upper)
        weighed = measure * weight(t - self.starts[rows, None])
        values = np.einsum("pg,pgn->pn", weighed, lagrange(self.time[nodes], t))
        return self._matrix(values.ravel(), np.repeat(rows, NODES), nodes.ravel())

    def _matrix(self, values: Array, rows: Indices, columns: Indices, width: int | None = None) -> sp.csr_matrix:
        return sp.csr_matrix((values, (rows, columns)), shape=(len(self), width or len(self.time)))

    def _weight(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        return np.asarray(np.sin(phase) ** 4, dtype=float)

    def _slope(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        return np.asarray(4.0 * np.pi / self.width * np.sin(phase) ** 3 * np.cos(phase), dtype=float)

    def _curvature(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        sine, cosine = np.sin(phase), np.cos(phase)
        return np.asarray(4.0 * (np.pi / self.width) ** 2 * sine**2 * (3.0 * cosine**2 - sine**2), dtype=float)

    def _jerk(self, since: Array) -> Array:
        phase = np.pi * np.clip(since, 0.0, self.width) / self.width
        sine, cosine = np.sin(phase), np.cos(phase)
        third = 4.0 * (np.pi / self.width) ** 3 * sine * cosine * (6.0 * cosine**2 - 10.0 * sine**2)
        return np.asarray(third, dtype=float)

    def _antiderivative(self, since: Array) -> Array:
        """∫₀ˢ sin⁴(π t/T) dt = T/π (3x/8 − sin 2x/4 + sin 4x/32), x = π s/T."""
        x = np.pi * np.clip(since, 0.0, self.width) / self.width
        antiderivative = self.width / np.pi * (0.375 * x - 0.25 * np.sin(2.0 * x) + np.sin(4.0 * x) / 32.0)
        return np.asarray(antiderivative, dtype=float)


def _jump(count: int) -> sp.dia_array:
    """(K, K): by how much each of `count` values differs from the one before it; the first from nothing."""
    return sp.diags_array([np.ones(count), -np.ones(count - 1)], offsets=[0, -1])


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
