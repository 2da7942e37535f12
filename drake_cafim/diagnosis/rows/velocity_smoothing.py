"""The velocity at which force laws with a kink are evaluated: smoothed little where v crosses zero, widely at rest.

Friction of a joint at rest follows the load, not the sign of the velocity's noise, so near rest the velocity is
smoothed over wider windows: at each sample over one half as wide as the widest that agrees with all narrower ones
within the noise (Lepski, Theory of Probability and its Applications 35(3), 1991). Half as wide, because the velocity
has a corner where friction changes its sign, and a bias there that the noise of narrow windows hides would still be
several standard deviations of the widest one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, filtered_std
from drake_cafim.diagnosis.thresholds import (
    AGREEING_VELOCITY_STDS,
    RESTING_SMOOTHING_REACHES,
    RESTING_VELOCITY_STDS,
    VELOCITY_SMOOTHING_REACH,
)
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Noise:
    """The noise of one column: standard deviation of a sample, and its correlation model `memory` (None: white)."""

    std: float
    memory: CorrelatedNoise | None = None


@dataclass(frozen=True)
class VelocityNoise:
    """The noise of a joint's measured positions, and of its velocities (None where they are not measured)."""

    q: Noise
    v: Noise | None


@dataclass(frozen=True)
class Velocity:
    """The linear smoother v̂ = `from_v @ v + from_q @ q`, both (N, N), with the standard deviation `std` (N,) of v̂."""

    from_v: sp.csr_matrix
    from_q: sp.csr_matrix
    std: Array

    @classmethod
    def over(cls, reach: float, time: Array, noise: VelocityNoise) -> "Velocity":
        """The smoother over `reach` s on either side; v and the slope of q are weighted by their inverse variances.

        Cached for other recordings with the same `time` (N,) s.
        """
        return _over(time.tobytes(), reach, noise)

    def of(self, q: Array, v: Array) -> Array:
        """v̂ (N,) from measured `q` and `v` (N,)."""
        return np.asarray(self.from_v @ v + self.from_q @ q, dtype=float)


def resting(time: Array, q: Array, v: Array, noise: VelocityNoise) -> Velocity:
    """The smoother for a joint with measured `q` and `v` (N,) at `time` (N,) s, over wider windows near rest."""
    before = Velocity.over(VELOCITY_SMOOTHING_REACH, time, noise)
    tried, chosen, seen = [before], np.zeros(len(time), dtype=np.int64), before.of(q, v)
    step = float(np.median(np.diff(time)))
    near = maximum_filter1d(
        np.abs(seen) < RESTING_VELOCITY_STDS * before.std, _samples(RESTING_SMOOTHING_REACHES[-1], step)
    )
    narrower = [(seen, AGREEING_VELOCITY_STDS * before.std)]
    for reach in RESTING_SMOOTHING_REACHES:
        if not np.any(near):
            break
        wider = Velocity.over(reach, time, noise)
        seen = wider.of(q, v)
        # for nested least-squares windows the difference is no noisier than the narrower estimate
        agree = np.all([np.abs(seen - estimate) < limit for estimate, limit in narrower], axis=0)
        near &= minimum_filter1d(agree, _samples(reach, step))
        chosen[near] = len(tried) - 1
        before = wider
        tried.append(wider)
        narrower.append((seen, AGREEING_VELOCITY_STDS * wider.std))
    return _chosen(tried, chosen)


def _chosen(smoothers: Sequence[Velocity], index: np.ndarray[Any, np.dtype[np.int64]]) -> Velocity:
    """The smoother that is `smoothers[index[k]]` at sample k."""
    if not np.any(index):
        return smoothers[0]
    used = smoothers[: int(index.max()) + 1]
    row = index * len(index) + np.arange(len(index))
    return Velocity(
        sp.csr_matrix(sp.vstack([smoother.from_v for smoother in used], format="csr")[row]),
        sp.csr_matrix(sp.vstack([smoother.from_q for smoother in used], format="csr")[row]),
        np.concatenate([smoother.std for smoother in used])[row],
    )


def _samples(reach: float, step: float) -> int:
    """The number of samples within `reach` s on either side, for a sampling time of `step` s."""
    return 2 * int(np.floor(reach / step + 1e-9)) + 1


@lru_cache(maxsize=64)
def _over(at: bytes, reach: float, noise: VelocityNoise) -> Velocity:
    slope, smooth = _fitted(at, reach)
    by_q = noise.q.std * _unit_std(at, reach, noise.q.memory, of_slope=True)
    if noise.v is None:
        return Velocity(sp.csr_matrix(smooth.shape), slope, by_q)
    by_v = noise.v.std * _unit_std(at, reach, noise.v.memory, of_slope=False)
    share = by_q**2 / np.maximum(by_q**2 + by_v**2, 1e-300)
    return Velocity(
        sp.csr_matrix(sp.diags_array(share) @ smooth),
        sp.csr_matrix(sp.diags_array(1.0 - share) @ slope),
        np.hypot(share * by_v, (1.0 - share) * by_q),
    )


@lru_cache(maxsize=16)
def _fitted(at: bytes, reach: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """The slope and the value (N, N) of local polynomials over `reach` s on either side, the same for all joints."""
    time = np.frombuffer(at)
    return local_polynomial(time, reach, 3, 1, at_least=3), local_polynomial(time, reach, 2, 0, at_least=2)


@lru_cache(maxsize=64)
def _unit_std(at: bytes, reach: float, memory: CorrelatedNoise | None, *, of_slope: bool) -> Array:
    """Standard deviation (N,) of `_fitted`'s slope or value of unit noise."""
    slope, smooth = _fitted(at, reach)
    return filtered_std(slope if of_slope else smooth, np.frombuffer(at), memory)
