"""Test functions for efforts that their maker filtered: the filter is applied to the other side of the equation alike.

Of an effort u_F = F u, for a linear filter F, the equations of motion hold filtered: F [M v̇ + h − forces] = u_F. With
test functions w, ∫ w F[r] dt = ∫ (Fᵀ w) r dt: what multiplies the motion and the forces is Fᵀ w, what multiplies the
recorded effort is w. Then no regressor contains frequencies that the effort has lost.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.signal import butter, sosfilt, sosfiltfilt

from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.scenario.schema import Lowpass
from drake_cafim.typing import Array

RESPONSE_SHARE = 0.01
"""Share of the impulse response's absolute area that is left out beyond its `reach`."""
ROWS_TOGETHER = 256
"""Number of windows that are filtered at once, to limit memory."""


def apply_filter(lowpass: Lowpass, values: Array, rate: float) -> Array:
    """`values` (N, ...) filtered along the first axis as their maker did; `rate` is the sampling rate, Hz.

    A Butterworth filter, applied once, or forwards and backwards where it is of zero phase.
    """
    sections = butter(lowpass.order, lowpass.cutoff, fs=rate, output="sos")
    run = sosfiltfilt if lowpass.zero_phase else sosfilt
    return np.asarray(run(sections, values, axis=0), dtype=float)


def reach_of(lowpass: Lowpass, rate: float) -> int:
    """Samples on either side of an impulse beyond which `RESPONSE_SHARE` of its response is left."""
    half = int(np.ceil(20.0 * lowpass.order * rate / lowpass.cutoff / (2.0 * np.pi)))
    impulse = np.zeros(2 * half + 1)
    impulse[half] = 1.0
    response = np.abs(apply_filter(lowpass, impulse, rate))
    outwards = np.cumsum((response + response[::-1])[half:])
    return int(np.searchsorted(outwards, (1.0 - RESPONSE_SHARE) * outwards[-1]))


@dataclass(frozen=True)
class FilteredWindows(Windows):
    """Windows whose `value` and `rate` are filtered like the recorded efforts, by the `lowpass` of their maker.

    `held` and `steps` are of the recorded efforts themselves.
    """

    lowpass: Lowpass = Lowpass()  # noqa: RUF009

    @classmethod
    def of(cls, windows: Windows, lowpass: Lowpass) -> "FilteredWindows":
        """The `windows` for efforts that were filtered by `lowpass`."""
        return cls(windows.time, windows.starts, windows.width, windows.first, windows.stop, lowpass=lowpass)

    @cached_property
    def value(self) -> sp.csr_matrix:
        return self._filtered(self._product(self._weight))

    @cached_property
    def rate(self) -> sp.csr_matrix:
        return self._filtered(self._product(self._slope))

    def _filtered(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        """`rows` (M, N) times the filter's matrix: each row filtered by Fᵀ, which runs backwards in time."""
        rate = 1.0 / float(np.median(np.diff(self.time)))
        reach = reach_of(self.lowpass, rate)
        parts = []
        for start in range(0, len(self), ROWS_TOGETHER):
            block = rows[start : start + ROWS_TOGETHER].toarray()
            first, stop = self.first[start : start + ROWS_TOGETHER], self.stop[start : start + ROWS_TOGETHER]
            filtered = apply_filter(self.lowpass, block.T[::-1], rate)[::-1].T
            index = np.arange(block.shape[1])
            near = (index >= (first - reach)[:, None]) & (index < (stop + reach)[:, None])
            parts.append(sp.csr_matrix(np.where(near, filtered, 0.0)))
        return sp.csr_matrix(sp.vstack(parts, format="csr"))
