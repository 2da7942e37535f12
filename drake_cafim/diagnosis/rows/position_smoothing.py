"""Positions for contact states that depend on the past, smoothed adaptively (Lepski's method) so that bias < noise."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, difference_std
from drake_cafim.diagnosis.thresholds import POSITION_SMOOTHING_DEGREE, POSITION_SMOOTHING_REACHES
from drake_cafim.numerics.local_polynomial import track_polynomial
from drake_cafim.typing import Array

Indices: TypeAlias = np.ndarray[Any, np.dtype[np.intp]]


@dataclass(frozen=True)
class Track:
    """One joint's position from its measured positions and velocities, with a smoothing width chosen for each sample.

    A contact state (a bristle's deflection, say) integrates the motion and with it the noise, so the motion is smoothed
    widely; but where friction changes its sign the acceleration jumps, and a wide polynomial is biased there. Each
    sample uses the widest window whose position agrees with those of all narrower ones, within the noise of their
    difference (Lepski, Theory of Probability and its Applications 35(3), 1991; Goldenshluger, Nemirovski, Math. Methods
    of Statistics 6(2), 1997).
    """

    smoothers: tuple[tuple[sp.csr_matrix, sp.csr_matrix], ...]
    """For each of K windows, the widest first, a pair (N, N): its position is `from_q @ q + from_v @ v`."""
    apart: Array
    """(K, K, N) standard deviation of the difference of two windows' positions by noise, m or rad."""
    near: int
    """Samples on either side that lie within the narrowest window."""

    def of(self, q: Array, v: Array) -> Array:
        """The smoothed position (N,) from measured `q` and `v` (N,)."""
        found = np.stack([from_q @ q + from_v @ v for from_q, from_v in self.smoothers])
        return np.asarray(np.sum(self._weights(found) * found, axis=0), dtype=float)

    def _weights(self, found: Array) -> Array:
        """Weights (K, N) of the windows at each sample, given the windows' positions `found` (K, N).

        A wide polynomial's error changes its sign on the way across a jump, where it agrees by chance: so a window is
        rejected near samples at which it disagrees, too. Weights change gradually from one window to the next, since a
        step between their positions would be a motion that never happened.
        """
        width = 2 * self.near + 1
        selected = maximum_filter1d(self._select(found), width)
        each = (selected == np.arange(len(found))[:, None]).astype(float)
        return np.asarray(uniform_filter1d(each, width, axis=1, mode="nearest"), dtype=float)

    def _select(self, found: Array) -> Indices:
        """(N,) index of the widest window that agrees with all narrower ones.

        The tolerance is √(2 ln N) standard deviations, which the largest of N normal errors hardly exceeds, so that
        noise alone is not mistaken for a jump (Donoho, Johnstone, Biometrika 81(3), 1994).
        """
        most = np.sqrt(2.0 * np.log(max(found.shape[1], 2))) * self.apart
        agree = np.abs(found[:, None] - found) <= most
        wider_or_same = np.tri(len(found), dtype=bool)[..., None]
        with_narrower = np.all(agree | wider_or_same, axis=1)
        # a window counts only where all narrower ones agree among each other, too
        good = np.logical_and.accumulate(with_narrower[::-1], axis=0)[::-1]
        return np.asarray(np.argmax(good, axis=0))


def track_of(
    time: Array,
    std_q: float,
    std_v: float,
    memory_q: CorrelatedNoise | None,
    memory_v: CorrelatedNoise | None,
    widest: bool = False,
) -> Track:
    """The track of a joint whose positions and velocities, sampled at `time` (N,) s, have this noise; cached.

    `std_v` is 0 where velocities are not measured; with `widest` the widest window is the only one.
    """
    return _track_of(
        time.tobytes(),
        std_q,
        std_v,
        memory_q,
        memory_v,
        POSITION_SMOOTHING_REACHES[:1] if widest else POSITION_SMOOTHING_REACHES,
    )


@lru_cache(maxsize=32)
def _track_of(
    at: bytes,
    std_q: float,
    std_v: float,
    memory_q: CorrelatedNoise | None,
    memory_v: CorrelatedNoise | None,
    reaches: tuple[float, ...],
) -> Track:
    time = np.frombuffer(at)
    ratio = std_q / std_v if std_v > 0.0 else 0.0
    smoothers = tuple(track_polynomial(time, reach, POSITION_SMOOTHING_DEGREE, ratio) for reach in reaches)
    from_q, from_v = zip(*smoothers, strict=True)
    apart = np.hypot(std_q * difference_std(from_q, time, memory_q), std_v * difference_std(from_v, time, memory_v))
    near = int(np.floor(reaches[-1] / np.median(np.diff(time)) + 1e-9))
    return Track(smoothers, apart, near)
