"""The velocity at which force laws with a kink are evaluated: smoothed little where v crosses zero, widely at rest.

Friction of a joint at rest follows the load, not the sign of the velocity's noise, so near rest the velocity is
smoothed over wider windows: at each sample over one half as wide as the widest that agrees with all narrower ones
within the noise (Lepski, Theory of Probability and its Applications 35(3), 1991). Half as wide, because the velocity
has a corner where friction changes its sign, and a bias there that the noise of narrow windows hides would still be
several standard deviations of the widest one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

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
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.local_polynomial import CACHED_SAMPLES, local_polynomial
from drake_cafim.typing import Array, Indices

CACHED_STDS = 32
"""Most cached standard deviations of smoothed unit noise."""


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
    return near_rest(time, q[:, None], v[:, None], [noise])[0]


def near_rest(time: Array, q: Array, v: Array, noise: Sequence[VelocityNoise]) -> tuple[Velocity, ...]:
    """Each joint's smoother, with measured `q` and `v` (N, n) at `time` (N,) s, over wider windows near rest.

    All joints together: the widest windows' matrices take gigabytes of a long recording, and there are two of them at
    a time.
    """
    step = float(np.median(np.diff(time)))
    before = _fitted(time, VELOCITY_SMOOTHING_REACH)
    joints = [_Resting(before, step, q[:, j], v[:, j], of_joint) for j, of_joint in enumerate(noise)]
    for reach in RESTING_SMOOTHING_REACHES:
        if not any(np.any(joint.near) for joint in joints):
            break
        wider = _fitted(time, reach)
        for joint in joints:
            if np.any(joint.near):
                joint.widen(before, wider, _samples(reach, step))
        before = wider
    return tuple(
        joint.chosen(Velocity.over(VELOCITY_SMOOTHING_REACH, time, of_joint))
        for joint, of_joint in zip(joints, noise, strict=True)
    )


@dataclass(frozen=True)
class _Fitted:
    """Local polynomials over `reach` s about each of N samples, weighed for a joint's noise only when they are used."""

    time: Array
    slope: sp.csr_matrix
    value: sp.csr_matrix
    _stds: dict[tuple[CorrelatedNoise | None, bool], Array] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def over(cls, time: Array, reach: float) -> "_Fitted":
        """Of positions the slope, of velocities the value."""
        slope = local_polynomial(time, reach, 3, 1, at_least=3)
        return cls(time, slope, local_polynomial(time, reach, 2, 0, at_least=2))

    def of(self, q: Array, v: Array, noise: VelocityNoise) -> tuple[Array, Array]:
        """The smoothed velocity of a joint, and its standard deviation; each (N,)."""
        share, std = self._share(noise)
        smoothed = (1.0 - share) * (self.slope @ q)
        return np.asarray(smoothed if noise.v is None else share * (self.value @ v) + smoothed), std

    def rows(self, index: Indices, noise: VelocityNoise) -> Velocity:
        """Rows `index` (K,) of the smoother of a joint, (K, N)."""
        share, std = self._share(noise)
        kept, rest = (sp.diags_array(values[index]) for values in (share, 1.0 - share))
        none = sp.csr_matrix((len(index), len(self.time)))
        from_v = none if noise.v is None else kept @ self.value[index]
        return Velocity(sp.csr_matrix(from_v), sp.csr_matrix(rest @ self.slope[index]), std[index])

    def _share(self, noise: VelocityNoise) -> tuple[Array, Array]:
        """The weight (N,) of the velocities beside the slope of the positions, and the estimate's std."""
        by_q = noise.q.std * self._unit_std(noise.q.memory, of_slope=True)
        if noise.v is None:
            return np.zeros_like(by_q), by_q
        by_v = noise.v.std * self._unit_std(noise.v.memory, of_slope=False)
        share = by_q**2 / np.maximum(by_q**2 + by_v**2, 1e-300)
        return share, np.hypot(share * by_v, (1.0 - share) * by_q)

    def _unit_std(self, memory: CorrelatedNoise | None, *, of_slope: bool) -> Array:
        """Standard deviation (N,) of the slope or the value by noise of unit std; cached."""
        if (memory, of_slope) not in self._stds:
            found = filtered_std(self.slope if of_slope else self.value, self.time, memory)
            make_room(self._stds, CACHED_STDS)
            self._stds[memory, of_slope] = found
        return self._stds[memory, of_slope]


class _Resting:
    """One joint near rest: how far its windows are widened at each sample, and the rows of the wider smoothers."""

    def __init__(self, narrow: _Fitted, step: float, q: Array, v: Array, noise: VelocityNoise) -> None:
        self.q, self.v, self.noise = q, v, noise
        seen, std = narrow.of(q, v, noise)
        self.near = maximum_filter1d(
            np.abs(seen) < RESTING_VELOCITY_STDS * std, _samples(RESTING_SMOOTHING_REACHES[-1], step)
        )
        self.narrower = [(seen, AGREEING_VELOCITY_STDS * std)]
        self.index = np.zeros(len(q), dtype=np.int64)
        self.found: list[tuple[Indices, Velocity]] = []

    def widen(self, before: _Fitted, wider: _Fitted, samples: int) -> None:
        """Chooses `before` where `wider`, over `samples`, agrees with all narrower ones."""
        seen, std = wider.of(self.q, self.v, self.noise)
        # for nested least-squares windows the difference is no noisier than the narrower estimate
        agree = np.all([np.abs(seen - estimate) < limit for estimate, limit in self.narrower], axis=0)
        self.near &= minimum_filter1d(agree, samples)
        tried = len(self.narrower) - 1
        self.index[self.near] = tried
        if tried:
            rows = np.flatnonzero(self.near)
            self.found.append((rows, before.rows(rows, self.noise)))
        self.narrower.append((seen, AGREEING_VELOCITY_STDS * std))

    def chosen(self, narrow: Velocity) -> Velocity:
        """The smoother that is `narrow` where no wider one was chosen."""
        if not np.any(self.index):
            return narrow
        parts, places = [], []
        for k, (rows, smoother) in enumerate([(np.arange(len(self.q)), narrow), *self.found]):
            own = np.flatnonzero(self.index[rows] == k)
            parts.append((smoother.from_v[own], smoother.from_q[own], smoother.std[own]))
            places.append(rows[own])
        order = np.argsort(np.concatenate(places))
        from_v, from_q, std = zip(*parts, strict=True)
        return Velocity(
            sp.csr_matrix(sp.vstack(from_v, format="csr")[order]),
            sp.csr_matrix(sp.vstack(from_q, format="csr")[order]),
            np.concatenate(std)[order],
        )


def _samples(reach: float, step: float) -> int:
    """The number of samples within `reach` s on either side, for a sampling time of `step` s."""
    return 2 * int(np.floor(reach / step + 1e-9)) + 1


@lru_cache(maxsize=8)
def _over(at: bytes, reach: float, noise: VelocityNoise) -> Velocity:
    time = np.frombuffer(at)
    return _fitted(time, reach).rows(np.arange(len(time)), noise)


def _fitted(time: Array, reach: float) -> _Fitted:
    """The local polynomials over `reach` s, the same for all joints; of short recordings cached for the next one."""
    return _known(time.tobytes(), reach) if len(time) <= CACHED_SAMPLES else _Fitted.over(time, reach)


@lru_cache(maxsize=16)
def _known(at: bytes, reach: float) -> _Fitted:
    return _Fitted.over(np.frombuffer(at), reach)
