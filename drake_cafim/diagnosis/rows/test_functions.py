"""Smooth test functions over a recording: the weak form's integrals as sparse matrices.

A measurement is never differentiated: with a smooth w(t) on [t₀, t₀ + T], zero outside, integration by parts moves the
derivative of a momentum p onto w, ∫ w ṗ dt = −∫ ẇ p dt. The test functions are cubic B-splines with equidistant knots,
four of which overlap everywhere (de Boor, A Practical Guide to Splines, 1978, ch. IX). They sum to one exactly, so that
sums over many rows telescope: p appears there only at the ends. What acts slowly is seen in such sums; test functions
with a rippled sum let the noise of p back into them.

Between samples, evenly spaced or not, the integrand's other factor is interpolated by cubics and w is exact; the error
of the cubics where a held effort steps, or a ramped one changes its slope, is corrected.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.quadrature import NODES, gauss, lagrange, missed_kink
from drake_cafim.diagnosis.thresholds import LONGEST_PAUSE_OF_WINDOW
from drake_cafim.numerics.cache import make_room
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
    _steps: dict[tuple[bytes, bool], sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)
    _kinks: dict[tuple[bytes, int], Array] = field(default_factory=dict, repr=False, compare=False)

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

    def steps(self, times: Array, ramped: bool = False) -> sp.csr_matrix:
        """(M, K) correction of `rate @ q + value @ v` for accelerations (K,) held from each of `times` (K,) s on.

        The cubics between samples have an error where the acceleration steps, as the slope of v and the curvature of q
        jump. If `ramped`, accelerations are linear between `times`, and the next higher derivatives jump. Cached.
        """
        return self._cached(self._steps, times, ramped, self._correction_of_steps)

    def _correction_of_steps(self, times: Array, ramped: bool) -> sp.csr_matrix:
        clipped, rows, columns = self._overlaps(times)
        since = clipped[columns] - self.starts[rows]
        order = 2 if ramped else 1
        lower, upper = self._kink(clipped, order), missed_kink(self.time, clipped, order + 1)
        area, moment = lower[0, columns], lower[1, columns] + upper[0, columns]
        jumps = self._weight(since) * area + self._slope(since) * moment
        return sp.csr_matrix(-self._matrix(jumps, rows, columns, len(times)) @ _jump(times, ramped))

    def held(self, times: Array, ramped: bool = False) -> sp.csr_matrix:
        """(M, K) matrix: `held @ u` is ∫ w u dt for values u (K,) held from each of `times` (K,) s to the next. Cached.

        If `ramped`, u is linear between `times` and constant after the last. Includes the correction of `rate` for the
        cubics' error where the momentum's slope jumps by Δu because u steps (its curvature, where u is ramped).
        """
        return self._cached(self._held, times, ramped, self._integral_of_held)

    def _kink(self, times: Array, order: int) -> Array:
        """`missed_kink` (3, K) of `order` at `times` (K,) s; the last one is cached, as two integrals need it."""
        key = times.tobytes(), order
        if key not in self._kinks:
            make_room(self._kinks, 1)
            self._kinks[key] = missed_kink(self.time, times, order)
        return self._kinks[key]

    def _cached(
        self,
        known: dict[tuple[bytes, bool], sp.csr_matrix],
        times: Array,
        ramped: bool,
        compute: Callable[[Array, bool], sp.csr_matrix],
    ) -> sp.csr_matrix:
        key = times.tobytes(), ramped
        if key not in known:
            make_room(known, 12)
            known[key] = compute(times, ramped)
        return known[key]

    def _overlaps(self, times: Array) -> tuple[Array, Indices, Indices]:
        """`times` (K,) s clipped to the recording, and the indices of window and time for every pair that overlaps."""
        clipped = np.clip(times, self.time[0], self.time[-1])
        first = np.searchsorted(times, self.starts, side="right") - 1
        stop = np.searchsorted(times, self.starts + self.width, side="left")
        first = np.clip(first, 0, None)
        counts = np.maximum(stop - first, 0)
        rows = np.repeat(np.arange(len(self)), counts)
        columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
        return clipped, rows, columns

    def _integral_of_held(self, times: Array, ramped: bool) -> sp.csr_matrix:
        clipped, rows, columns = self._overlaps(times)
        origin = self.starts[rows]
        missed = self._kink(clipped, 2 if ramped else 1)[:, columns]
        since = clipped[columns] - origin
        weights_there = (self._slope(since), self._curvature(since), self._jerk(since))
        at_step = sum(weight * moment for weight, moment in zip(weights_there, missed, strict=True))
        begin, end = since, np.append(clipped[1:], self.time[-1])[columns] - origin
        weights = self._antiderivative(end) - self._antiderivative(begin)
        integral = self._matrix(weights, rows, columns, len(times))
        if ramped:
            # u = u_k + (t − t_k)/(t_k+1 − t_k) Δu: by parts, ∫ w (t − t_k) dt = [(t − t_k) ∫w − ∬w]
            lasting = end - begin
            moment = lasting * self._antiderivative(end)
            moment -= self._second_antiderivative(end) - self._second_antiderivative(begin)
            share = np.divide(moment, lasting, where=lasting > 0.0, out=0.0 * moment)
            following = np.minimum(columns + 1, len(times) - 1)
            integral = integral + self._matrix(share, rows, following, len(times))
            integral = integral - self._matrix(share, rows, columns, len(times))
        return sp.csr_matrix(integral + self._matrix(at_step, rows, columns, len(times)) @ _jump(times, ramped))

    def at(self, times: Array, measure: Array) -> sp.csr_matrix:
        """(M, P) matrix: `at(times, measure) @ f` is Σ w f `measure` for values f (P,) at increasing `times` (P,) s."""
        first = np.searchsorted(times, self.starts, side="left")
        counts = np.searchsorted(times, self.starts + self.width, side="right") - first
        rows = np.repeat(np.arange(len(self)), counts)
        columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
        return self._matrix(measure[columns] * self._weight(times[columns] - self.starts[rows]), rows, columns, len(times))

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

    def _curvature(self, since: Array) -> Array:
        x = np.abs(self._from_center(since))
        return np.asarray(np.where(x < 1.0, 3.0 * x - 2.0, 2.0 - x) / self.spacing**2, dtype=float)

    def _jerk(self, since: Array) -> Array:
        x = self._from_center(since)
        within = np.abs(x) < 2.0
        third = np.where(np.abs(x) < 1.0, 3.0, -1.0) * np.sign(x) * within
        return np.asarray(third / self.spacing**3, dtype=float)

    def _from_center(self, since: Array) -> Array:
        """`since` the windows' starts, clipped to their width, from their middles and in units of the spacing."""
        return np.clip(since, 0.0, self.width) / self.spacing - 2.0

    def _antiderivative(self, since: Array) -> Array:
        """∫₀ˢ w dt = h Σ_k (−1)ᵏ C(4, k) (s/h − k)₊⁴/24."""
        return self.spacing * self._powers(np.clip(since, 0.0, self.width), 4) / 24.0

    def _second_antiderivative(self, since: Array) -> Array:
        """∫₀ˢ of `_antiderivative`: h² Σ_k (−1)ᵏ C(4, k) (s/h − k)₊⁵/120, continued linearly after T."""
        after = self.spacing * np.maximum(since - self.width, 0.0)
        return self.spacing**2 * self._powers(np.clip(since, 0.0, self.width), 5) / 120.0 + after

    def _powers(self, since: Array, degree: int) -> Array:
        s = since / self.spacing
        terms = (c * np.maximum(s - k, 0.0) ** degree for k, c in enumerate((1.0, -4.0, 6.0, -4.0, 1.0)))
        return np.asarray(sum(terms), dtype=float)


def _jump(times: Array, ramped: bool) -> sp.csr_matrix:
    """(K, K) matrix of the differences of successive values, the first from zero; if `ramped`, of successive slopes."""
    ones = np.ones(len(times))
    jump = sp.diags_array([ones, -ones[1:]], offsets=[0, -1])
    if not ramped:
        return sp.csr_matrix(jump)
    apart = np.diff(times)
    rate = np.append(np.divide(1.0, apart, where=apart > 0.0, out=0.0 * apart), 0.0)
    slope = sp.diags_array([-rate, rate[:-1]], offsets=[0, 1])
    return sp.csr_matrix(jump @ slope)


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
