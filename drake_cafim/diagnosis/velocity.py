"""The velocity that kinked laws see: smoothed little where it passes through zero, and far where a joint rests.

Friction of a joint at rest follows the load, not the noise of its velocity; the mean of its sign over that noise says
nothing of it for as long as the rest lasts. So near rest each sample takes a window half as wide as the widest one that
agrees with all narrower ones, within what noise lets them differ (Lepski, Theory of Probability and its Applications
35(3), 1991): where friction turns its sign the motion has a corner, and what noise hides of its rounding off would
still be several times the noise of the widest.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from drake_cafim.diagnosis.coloured_noise import Lasting, left_by
from drake_cafim.local_polynomial import local_polynomial
from drake_cafim.typing import Array, Flags

SMOOTHING_REACH = 0.008
"""s on either side: the motion in products and kinked laws is smoothed over 16 ms."""
WIDER = (0.016, 0.032, 0.064, 0.128, 0.256)
"""s on either side, tried where a joint rests."""
RESTING = 4.0
"""Standard deviations of a velocity that is smoothed little, within which the joint may be at rest."""
AGREEING = 3.0
"""Standard deviations of the narrower one, within which two smoothed velocities agree."""


@dataclass(frozen=True)
class Noise:
    """Of one column: the standard deviation of a sample, and its memory."""

    std: float
    memory: Lasting | None = None


@dataclass(frozen=True)
class VelocityNoise:
    """Of a joint's positions, and of its velocities where they are measured."""

    q: Noise
    v: Noise | None


@dataclass(frozen=True)
class Velocity:
    """Smoothed v is `from_v @ v + from_q @ q`, both (N, N), of standard deviation `std` (N,)."""

    from_v: sp.csr_matrix
    from_q: sp.csr_matrix
    std: Array

    @classmethod
    def over(cls, reach: float, time: Array, noise: VelocityNoise) -> "Velocity":
        """Within `reach` s on either side, by what their noise leaves of positions and velocities.

        Kept for the next recording at the same `time` (N,) s.
        """
        return _over(time.tobytes(), reach, noise)

    def of(self, q: Array, v: Array) -> Array:
        """Smoothed v (N,) from measured `q` and `v` (N,)."""
        return np.asarray(self.from_v @ v + self.from_q @ q, dtype=float)

    def where(self, chosen: Flags, other: "Velocity") -> "Velocity":
        """This one at the samples `chosen` (N,), and `other` elsewhere."""
        own, others = sp.diags_array(chosen.astype(float)), sp.diags_array((~chosen).astype(float))
        return Velocity(
            sp.csr_matrix(own @ self.from_v + others @ other.from_v),
            sp.csr_matrix(own @ self.from_q + others @ other.from_q),
            np.where(chosen, self.std, other.std),
        )


def resting(time: Array, q: Array, v: Array, noise: VelocityNoise) -> Velocity:
    """Of a joint whose measured positions and velocities at `time` (N,) are `q` and `v` (N,)."""
    found = before = Velocity.over(SMOOTHING_REACH, time, noise)
    seen = before.of(q, v)
    step = float(np.median(np.diff(time)))
    near = maximum_filter1d(np.abs(seen) < RESTING * before.std, _samples(WIDER[-1], step))
    narrower = [(seen, AGREEING * before.std)]
    for reach in WIDER:
        if not np.any(near):
            break
        wider = Velocity.over(reach, time, noise)
        seen = wider.of(q, v)
        # of nested least squares the wider one's difference is no noisier than the narrower one
        agree = np.all([np.abs(seen - other) < limit for other, limit in narrower], axis=0)
        near &= minimum_filter1d(agree, _samples(reach, step))
        found, before = before.where(near, found), wider
        narrower.append((seen, AGREEING * wider.std))
    return found


def _samples(reach: float, step: float) -> int:
    """Within `reach` s on either side, `step` s apart."""
    return 2 * int(np.floor(reach / step + 1e-9)) + 1


@lru_cache(maxsize=64)
def _over(at: bytes, reach: float, noise: VelocityNoise) -> Velocity:
    time = np.frombuffer(at)
    slope = local_polynomial(time, reach, 3, 1, at_least=3)
    smooth = local_polynomial(time, reach, 2, 0, at_least=2)
    by_q = noise.q.std * left_by(slope, time, noise.q.memory)
    if noise.v is None:
        return Velocity(sp.csr_matrix(smooth.shape), slope, by_q)
    by_v = noise.v.std * left_by(smooth, time, noise.v.memory)
    share = by_q**2 / np.maximum(by_q**2 + by_v**2, 1e-300)
    return Velocity(
        sp.csr_matrix(sp.diags_array(share) @ smooth),
        sp.csr_matrix(sp.diags_array(1.0 - share) @ slope),
        np.hypot(share * by_v, (1.0 - share) * by_q),
    )
