"""Smooth test functions over a recording: the weak form's integrals as sparse matrices.

A measurement is never differentiated: with a smooth w(t) on [t₀, t₀ + T], zero outside, integration by parts moves the
derivative of a momentum p onto w, ∫ w ṗ dt = −∫ ẇ p dt. The test functions are cubic B-splines with equidistant knots,
four of which overlap everywhere (de Boor, A Practical Guide to Splines, 1978, ch. IX). They sum to one exactly, so that
sums over many rows telescope: p appears there only at the ends. What acts slowly is seen in such sums; test functions
with a rippled sum let the noise of p back into them.

Between samples, evenly spaced or not, the integrand's other factor is interpolated by cubics and w is exact. Forces
that step or bend between samples are integrated over each sample interval first, see `Windows.interval`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.thresholds import LONGEST_PAUSE_OF_WINDOW
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.quadrature import NODES, gauss, lagrange
from drake_cafim.typing import Array, Indices

OVERLAPPING = 4
"""Number of B-splines that are not zero at any time; of cubic ones."""


@dataclass(frozen=True)
class Windows:
    """M cubic B-splines w over samples at `time` (N,) s, a fourth of their width T apart where samples have no gap.

    `starts` t₀ (M,) s and `width` T s; each covers the samples from `first` (M,) up to `stop` (M,), exclusive, and lies
    in a run of usable samples from `run_first` (M,) up to `run_stop` (M,), exclusive.
    """

    time: Array
    starts: Array
    width: float
    first: Indices
    stop: Indices
    run_first: Indices
    run_stop: Indices
    _held: dict[tuple[bytes, bool], sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)
    _overlaps: dict[tuple[bytes, bool], "_Pieces"] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def spacing(self) -> float:
        """h = T/4, s, the distance of the knots of a B-spline, and of the B-splines themselves."""
        return self.width / OVERLAPPING

    @property
    def centers(self) -> Array:
        """(M,) s, the windows' middles."""
        return self.starts + 0.5 * self.width

    @cached_property
    def value(self) -> sp.csr_matrix:
        """(M, N) matrix: `value @ f` is ∫ w f dt for samples f (N,)."""
        return self._product(self._weight)

    @cached_property
    def rate(self) -> sp.csr_matrix:
        """(M, N) matrix: `rate @ f` is ∫ ẇ f dt for samples f (N,)."""
        return self._product(self._slope)

    @cached_property
    def interval(self) -> sp.csr_matrix:
        """(M, N − 1) matrix W̄: `rate @ p` is −W̄ Δp for the differences Δp (N − 1,) between samples.

        If ṗ is f, −`rate @ p` − W̄ ∫f is zero whatever f does between samples, where ∫f (N − 1,) are its integrals over
        the sample intervals: p − ∫f dt is constant, and the cubics through it are exact.
        """
        rate = self.rate
        counts = np.diff(rate.indptr)
        rows = np.repeat(np.arange(len(self)), counts)
        total = np.cumsum(rate.data)
        before = np.concatenate([[0.0], total])[rate.indptr[:-1]]
        # a row of `rate` sums to zero: minus the sum of what comes after a sample is the sum up to it
        values = total - np.repeat(before, counts)
        inside = rate.indices < len(self.time) - 1
        shape = (len(self), len(self.time) - 1)
        return sp.csr_matrix((values[inside], (rows[inside], rate.indices[inside])), shape=shape)

    @cached_property
    def velocity(self) -> sp.csr_matrix:
        """(M, N) matrix: `velocity @ v` is ∫ w v dt for velocities v (N,) that are linear between samples."""
        half = 0.5 * np.diff(self.time)
        count = len(half)
        ends = sp.diags_array([half, half], offsets=[0, 1], shape=(count, count + 1))
        return sp.csr_matrix(self.interval @ ends)

    def correct_steps(self, times: Array, accelerations: Array, ramped: bool = False) -> Array:
        """(M, k) correction of `rate @ q + velocity @ v` for `accelerations` (K, k) held from each of `times` (K,) on.

        With t̄ the middle of a sample interval, ∫ v dt = ½ h (v₁ + v₂) − ∫ (t − t̄) a dt. If `ramped`, accelerations are
        linear between `times`.
        """
        return np.asarray(self.interval @ (self._pieces(times, ramped).moment @ accelerations))

    def moments(self, times: Array, values: Array, ramped: bool = False) -> Array:
        """(N − 1,) ∫ (t − t̄) u dt over each sample interval, t̄ its middle, of `values` u (K,) as in `held`."""
        return np.asarray(self._pieces(times, ramped).moment @ values)

    def integrate_held(self, times: Array, values: Array, ramped: bool = False) -> Array:
        """(M,) ∫ w u dt of `values` u (K,) held from each of `times` (K,) s to the next; see `held`."""
        return np.asarray(self.interval @ (self._pieces(times, ramped).integral @ values))

    def held(self, times: Array, ramped: bool = False) -> sp.csr_matrix:
        """(M, K) matrix: `held @ u` is ∫ w u dt for values u (K,) held from each of `times` (K,) s to the next. Cached.

        If `ramped`, u is linear between `times` and constant after the last. It is exact beside `rate`, see `interval`.
        """
        key = times.tobytes(), ramped
        if key not in self._held:
            make_room(self._held, 12)
            self._held[key] = sp.csr_matrix(self.interval @ self._pieces(times, ramped).integral)
        return self._held[key]

    def _pieces(self, times: Array, ramped: bool) -> "_Pieces":
        """The integrals and moments over sample intervals of values at `times`; the last ones are cached."""
        key = times.tobytes(), ramped
        if key not in self._overlaps:
            make_room(self._overlaps, 4)
            self._overlaps[key] = _Pieces.of(self.time, times, ramped)
        return self._overlaps[key]

    def at(self, interval: Indices, measure: Array) -> sp.csr_matrix:
        """(M, P) matrix: `at(...) @ f` is ∫ w f dt for values f (P,) at points, each in its sample `interval` (P,).

        Their weights `measure` (P,) s add up to each interval's length.
        """
        sums = sp.csr_matrix((measure, (interval, np.arange(len(interval)))), shape=(len(self.time) - 1, len(interval)))
        return sp.csr_matrix(self.interval @ sums)

    def rows(self, per_window: Array) -> Array:
        """`per_window` (M, r, ...) flattened to (M r, ...), window after window."""
        return per_window.reshape(-1, *per_window.shape[2:])

    def _product(self, weight: Callable[[Array], Array]) -> sp.csr_matrix:
        """(M, N) matrix of ∫ weight(t − t₀) f dt, with f cubic between samples, of the window's run alone."""
        counts = self.stop - self.first
        rows = np.repeat(np.arange(len(self)), counts + 1)
        place = np.arange(len(rows)) - np.repeat(np.cumsum(counts + 1) - counts - 1, counts + 1)
        # a window starts a little before its first sample and ends a little after its last
        right = self.first[rows] + place
        lower = np.where(place == 0, self.starts[rows], self.time[np.maximum(right - 1, 0)])
        last = np.minimum(right, len(self.time) - 1)
        upper = np.where(place == counts[rows], self.starts[rows] + self.width, self.time[last])
        nodes = np.clip(right - 2, self.run_first[rows], self.run_stop[rows] - NODES)[:, None] + np.arange(NODES)
        # a piece ends at a knot, where the third derivative of w jumps; there is at most one between two samples
        knot = self.starts[rows] + self.spacing * (np.floor((lower - self.starts[rows]) / self.spacing + 1e-9) + 1.0)
        split = np.clip(knot, lower, upper)
        values = np.zeros((len(rows), NODES))
        for begin, end in ((lower, split), (split, upper)):
            t, measure = gauss(begin, end)
            weighed = measure * weight(t - self.starts[rows, None])
            values += np.einsum("pg,pgn->pn", weighed, lagrange(self.time[nodes], t))
        return self._matrix(values.ravel(), np.repeat(rows, NODES), nodes.ravel())

    def _matrix(self, values: Array, rows: Indices, columns: Indices, width: int | None = None) -> sp.csr_matrix:
        return sp.csr_matrix((values, (rows, columns)), shape=(len(self), width or len(self.time)))

    def _weight(self, since: Array) -> Array:
        x = self._from_center(since)
        inner, outer = 4.0 - 6.0 * x**2 + 3.0 * np.abs(x) ** 3, (2.0 - np.abs(x)) ** 3
        return np.asarray(np.where(np.abs(x) < 1.0, inner, outer) / 6.0, dtype=float)

    def _slope(self, since: Array) -> Array:
        x = self._from_center(since)
        inner, outer = x * (1.5 * np.abs(x) - 2.0), -0.5 * np.sign(x) * (2.0 - np.abs(x)) ** 2
        return np.asarray(np.where(np.abs(x) < 1.0, inner, outer) / self.spacing, dtype=float)

    def _from_center(self, since: Array) -> Array:
        """`since` the windows' starts, clipped to their width, from their middles and in units of the spacing."""
        return np.clip(since, 0.0, self.width) / self.spacing - 2.0


@dataclass(frozen=True)
class _Pieces:
    """Integrals over N − 1 sample intervals of K values that are held, or ramped, from time to time.

    `integral` (N − 1, K): ∫ u dt; `moment` (N − 1, K): ∫ (t − t̄) u dt about the interval's middle t̄.
    """

    integral: sp.csr_matrix
    moment: sp.csr_matrix

    @classmethod
    def of(cls, time: Array, times: Array, ramped: bool) -> "_Pieces":
        """For samples at `time` (N,) s and values from each of `times` (K,) s on; before the first it holds too."""
        grid = np.unique(np.concatenate([time, np.clip(times, time[0], time[-1])]))
        length, middle = np.diff(grid), 0.5 * (grid[1:] + grid[:-1])
        k = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 2)
        i = np.clip(np.searchsorted(times, middle, side="right") - 1, 0, None)
        arm = middle - 0.5 * (time[k] + time[k + 1])
        shape = (len(time) - 1, len(times))
        if not ramped:
            return cls(*(sp.csr_matrix((values, (k, i)), shape=shape) for values in (length, length * arm)))
        following = np.minimum(i + 1, len(times) - 1)
        apart = times[following] - times[i]
        steepness = np.divide(1.0, apart, where=apart > 0.0, out=np.zeros_like(apart))
        share = np.clip((middle - times[i]) * steepness, 0.0, 1.0)
        # ∫ (t − t̄) (t − tᵢ) dt over a piece has a part by its own length
        own = length**3 / 12.0 * steepness * (middle > times[i])
        rows, columns = np.concatenate([k, k]), np.concatenate([i, following])
        integral = np.concatenate([length * (1.0 - share), length * share])
        moment = np.concatenate([length * arm * (1.0 - share) - own, length * arm * share + own])
        return cls(*(sp.csr_matrix((values, (rows, columns)), shape=shape) for values in (integral, moment)))


def lay_windows(time: Array, usable: np.ndarray[Any, np.dtype[np.bool_]], width: float) -> Windows:
    """Windows of `width` s, a fourth of it apart, that lie within runs of usable samples.

    `usable` (N,) is True for samples at which all needed channels were measured. A run also ends where the next sample
    is more than `LONGEST_PAUSE_OF_WINDOW` median sampling times away.
    """
    steps, spacing = np.diff(time), width / OVERLAPPING
    breaks = ~usable[1:] | ~usable[:-1] | (steps > LONGEST_PAUSE_OF_WINDOW * np.median(steps))
    edges = np.flatnonzero(breaks)
    begins, ends = np.append(0, edges + 1), np.append(edges, len(time) - 1)
    starts: list[float] = []
    run_first: list[int] = []
    run_stop: list[int] = []
    for begin, end in zip(begins, ends, strict=True):
        count = int((time[end] - time[begin] - width) / spacing + 1e-9) + 1
        starts.extend(time[begin] + spacing * np.arange(max(count, 0)))
        run_first.extend([begin] * max(count, 0))
        run_stop.extend([end + 1] * max(count, 0))
    origin = np.array(starts, dtype=float)
    # a sample that lies exactly on a window's edge is included in spite of rounding; its weight is zero there
    first = np.searchsorted(time, origin - 1e-12, side="left")
    stop = np.searchsorted(time, origin + width + 1e-12, side="right")
    return Windows(time, origin, width, first, stop, np.array(run_first, dtype=int), np.array(run_stop, dtype=int))
