"""The motion that a contact remembers, smoothed only as far as its noise hides what smoothing takes away."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from drake_cafim.diagnosis.coloured_noise import Lasting, apart_by
from drake_cafim.local_polynomial import track_polynomial
from drake_cafim.typing import Array

Indices: TypeAlias = np.ndarray[Any, np.dtype[np.intp]]

REACHES, DEGREE = (0.06, 0.0424, 0.03, 0.0212, 0.015), 7
"""s on either side, the widest first and each √2 narrower, and the degree of the polynomial over each: none is much
noisier than the widest that would do."""


@dataclass(frozen=True)
class Track:
    """One joint's position from its measured positions and velocities, each sample over a width of its own.

    Noise in what a memory sums up would add up, so the motion is smoothed widely; but where friction turns its sign
    an acceleration jumps, and a wide polynomial rounds off what a bristle goes through there. Each sample takes the
    widest window that agrees with all narrower ones, to within what their noise lets them differ (Lepski, Theory of
    Probability and its Applications 35(3), 1991; Goldenshluger, Nemirovski, Math. Methods of Statistics 6(2), 1997).
    """

    smoothers: tuple[tuple[sp.csr_matrix, sp.csr_matrix], ...]
    """A pair (N, N) a window, the widest first: its position is `from_q @ q + from_v @ v`."""
    apart: Array
    """(K, K, N), m or rad: the standard deviation by which noise makes the positions of two windows differ."""
    near: int
    """Samples on either side that are within the narrowest reach."""

    def of(self, q: Array, v: Array) -> Array:
        """The position (N,) from measured `q` and `v` (N,)."""
        found = np.stack([from_q @ q + from_v @ v for from_q, from_v in self.smoothers])
        return np.asarray(np.sum(self._shares(found) * found, axis=0), dtype=float)

    def _shares(self, found: Array) -> Array:
        """How much of each window a sample takes, (K, N), of the positions (K, N) that they find.

        On its way across a jump a wide polynomial's error changes its sign, so a window is also left near where it
        does not agree; and one gives way to the next by and by, for a step between them is a way that nothing went.
        """
        width = 2 * self.near + 1
        taken = maximum_filter1d(self._narrowness(found), width)
        each = (taken == np.arange(len(found))[:, None]).astype(float)
        return np.asarray(uniform_filter1d(each, width, axis=1, mode="nearest"), dtype=float)

    def _narrowness(self, found: Array) -> Indices:
        """Which window is the widest that agrees with all narrower ones, (N,).

        √(2 ln N) standard deviations are what the largest of N errors comes to: noise alone is not taken for a jump
        (Donoho, Johnstone, Biometrika 81(3), 1994).
        """
        most = np.sqrt(2.0 * np.log(max(found.shape[1], 2))) * self.apart
        agree = np.abs(found[:, None] - found) <= most
        wider_or_same = np.tri(len(found), dtype=bool)[..., None]
        with_narrower = np.all(agree | wider_or_same, axis=1)
        # a window is as good as the narrower ones only where these are as good as each other
        good = np.logical_and.accumulate(with_narrower[::-1], axis=0)[::-1]
        return np.asarray(np.argmax(good, axis=0))


def track_of(
    time: Array, std_q: float, std_v: float, memory_q: Lasting | None, memory_v: Lasting | None, widest: bool = False
) -> Track:
    """The track of a joint whose positions and velocities at `time` (N,) s have this noise.

    Without velocities `std_v` is 0; `widest` leaves no other window. Kept for the next recording at the same times.
    """
    return _track_of(time.tobytes(), std_q, std_v, memory_q, memory_v, REACHES[:1] if widest else REACHES)


@lru_cache(maxsize=32)
def _track_of(
    at: bytes,
    std_q: float,
    std_v: float,
    memory_q: Lasting | None,
    memory_v: Lasting | None,
    reaches: tuple[float, ...],
) -> Track:
    time = np.frombuffer(at)
    ratio = std_q / std_v if std_v > 0.0 else 0.0
    smoothers = tuple(track_polynomial(time, reach, DEGREE, ratio) for reach in reaches)
    from_q, from_v = zip(*smoothers, strict=True)
    apart = np.hypot(std_q * apart_by(from_q, time, memory_q), std_v * apart_by(from_v, time, memory_v))
    near = int(np.floor(reaches[-1] / np.median(np.diff(time)) + 1e-9))
    return Track(smoothers, apart, near)
