"""Test functions for efforts that their maker filtered: the filter is applied to the other side of the equation alike.

Of an effort u_F = F u, for a linear filter F, the equations of motion hold filtered: F [M v̇ + h − forces] = u_F. With
test functions w, ∫ w F[r] dt = ∫ (Fᵀ w) r dt: what multiplies the motion and the forces is Fᵀ w, what multiplies the
recorded effort is w. Then no regressor contains frequencies that the effort has lost.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.signal import butter, fftconvolve, sosfilt, sosfiltfilt
from scipy.signal.windows import tukey
from scipy.sparse.linalg import splu

from drake_cafim.diagnosis.rows.test_functions import OVERLAPPING, Windows, lay_windows
from drake_cafim.scenario.schema import Lowpass
from drake_cafim.typing import Array

RESPONSE_SHARE = 0.001
"""Share of the impulse response's absolute area that is left out beyond its `reach`."""
FADING_SHARE = 0.5
"""Share of the response over which its two ends are faded out."""
ROWS_TOGETHER = 256
"""Number of windows that are filtered at once, to limit memory."""
NARROW_PER_PERIOD = 20.0
"""Narrow windows in a period of the cutoff: cubic splines this close follow a filtered window to a share of 1e-4."""
NARROWEST = 12.0
"""Least width of a narrow window, in sampling periods."""
LEAST_COEFFICIENT = 1e-6
"""Coefficient of a narrow window, over the largest one, that counts as rounding error."""


def apply_filter(lowpass: Lowpass, values: Array, rate: float) -> Array:
    """`values` (N, ...) filtered along the first axis as their maker did; `rate` is the sampling rate, Hz.

    A Butterworth filter, applied once, or forwards and backwards where it is of zero phase.
    """
    sections = butter(lowpass.order, lowpass.cutoff, fs=rate, output="sos")
    run = sosfiltfilt if lowpass.zero_phase else sosfilt
    return np.asarray(run(sections, values, axis=0), dtype=float)


def response(lowpass: Lowpass, rate: float) -> Array:
    """(2 K + 1,) the filter's impulse response about its middle, K samples on either side, with the sum 1.

    Beyond them `RESPONSE_SHARE` of its absolute area is left; what is at rest passes the filter unchanged all the same.
    """
    half = int(np.ceil(20.0 * lowpass.order * rate / lowpass.cutoff / (2.0 * np.pi)))
    impulse = np.zeros(2 * half + 1)
    impulse[half] = 1.0
    whole = apply_filter(lowpass, impulse, rate)
    outwards = np.cumsum(np.abs(whole[half:]) + np.abs(whole[half::-1]))
    reach = int(np.searchsorted(outwards, (1.0 - RESPONSE_SHARE) * outwards[-1]))
    # cut off at once, the response would ripple at all frequencies; faded out, it differs near the cutoff alone
    kept = whole[half - reach : half + reach + 1] * tukey(2 * reach + 1, FADING_SHARE)
    return np.asarray(kept / np.sum(kept))


def reach_of(lowpass: Lowpass, rate: float) -> int:
    """The number K of samples on either side that `response` covers."""
    return len(response(lowpass, rate)) // 2


@dataclass(frozen=True)
class FilteredWindows(Windows):
    """Windows whose `value` and `rate` are filtered like the recorded efforts, by the `lowpass` of their maker.

    `held`, `integrate_held` and `correct_steps` are of the recorded efforts themselves.
    """

    lowpass: Lowpass = Lowpass()  # noqa: RUF009

    @classmethod
    def of(cls, windows: Windows, lowpass: Lowpass) -> "FilteredWindows":
        """The `windows` for efforts that were filtered by `lowpass`."""
        runs = (windows.run_first, windows.run_stop)
        return cls(windows.time, windows.starts, windows.width, windows.first, windows.stop, *runs, lowpass=lowpass)

    @cached_property
    def _plain(self) -> Windows:
        """The windows before they are filtered."""
        return Windows(self.time, self.starts, self.width, self.first, self.stop, self.run_first, self.run_stop)

    def held(self, times: Array, ramped: bool = False) -> sp.csr_matrix:
        return self._plain.held(times, ramped)

    def integrate_held(self, times: Array, values: Array, ramped: bool = False) -> Array:
        return self._plain.integrate_held(times, values, ramped)

    def correct_steps(self, times: Array, accelerations: Array, ramped: bool = False) -> Array:
        return self._plain.correct_steps(times, accelerations, ramped)

    @cached_property
    def value(self) -> sp.csr_matrix:
        return self._filtered(self._product(self._weight))

    @cached_property
    def rate(self) -> sp.csr_matrix:
        return self._filtered(self._product(self._slope))

    @cached_property
    def narrow(self) -> Windows:
        """Narrow windows over the same samples and their responses, of which the filtered ones are combinations."""
        covered = np.zeros(len(self.time), dtype=bool)
        for first, stop in zip(self.first, self.stop, strict=True):
            covered[max(first - self._reach, 0) : stop + self._reach] = True
        width = OVERLAPPING / (NARROW_PER_PERIOD * self.lowpass.cutoff)
        return lay_windows(self.time, covered, max(width, NARROWEST * self._period))

    @cached_property
    def of_narrow(self) -> sp.csr_matrix:
        """(M, M') F: `value` ≈ F `narrow.value` and `rate` ≈ F `narrow.rate`, the nearest by least squares.

        The noise of samples is propagated to the narrow windows first, which cover few samples each.
        """
        narrow = self.narrow.value
        solve = splu(sp.csc_matrix(narrow @ narrow.T)).solve
        found = np.asarray(solve((narrow @ self.value.T).toarray()))
        found[np.abs(found) < LEAST_COEFFICIENT * np.max(np.abs(found), axis=0)] = 0.0
        return sp.csr_matrix(found.T)

    @property
    def _period(self) -> float:
        return float(np.median(np.diff(self.time)))

    @property
    def _reach(self) -> int:
        return reach_of(self.lowpass, 1.0 / self._period)

    def _filtered(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        """`rows` (M, N) times the filter's matrix: each row filtered by Fᵀ, which runs backwards in time."""
        kernel = response(self.lowpass, 1.0 / self._period)
        reach, index = len(kernel) // 2, np.arange(len(self.time))
        parts = []
        for start in range(0, len(self), ROWS_TOGETHER):
            together = slice(start, start + ROWS_TOGETHER)
            filtered = fftconvolve(rows[together].toarray(), kernel[None, ::-1], mode="same", axes=1)
            # beyond the reach the transform leaves rounding errors, which would fill the matrix
            near = (index >= self.first[together, None] - reach) & (index < self.stop[together, None] + reach)
            parts.append(sp.csr_matrix(np.where(near, filtered, 0.0)))
        return sp.csr_matrix(sp.vstack(parts, format="csr"))
