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

    The matrices of the widest windows, gigabytes of a long recording, are computed of all joints together and a few
    rows at a time; once more those rows that are chosen.
    """
    step = float(np.median(np.diff(time)))
    windows = [_fitted(time, VELOCITY_SMOOTHING_REACH)]
    joints = [_Resting(seen, std, step) for seen, std in windows[0].of(q, v, noise)]
    for reach in RESTING_SMOOTHING_REACHES:
        if not any(np.any(joint.near) for joint in joints):
            break
        windows.append(_fitted(time, reach))
        for joint, (seen, std) in zip(joints, windows[-1].of(q, v, noise), strict=True):
            if np.any(joint.near):
                joint.widen(seen, std, _samples(reach, step))
    return tuple(
        _chosen(joint.index, windows, of_joint) if np.any(joint.index) else windows[0].smoother(of_joint)
        for joint, of_joint in zip(joints, noise, strict=True)
    )


@dataclass(frozen=True)
class _Fitted:
    """Local polynomials over `reach` s about each of N samples, weighed for a joint's noise only when they are used."""

    time: Array
    reach: float
    _stds: dict[tuple[CorrelatedNoise | None, bool], Array] = field(default_factory=dict, repr=False, compare=False)

    def of(self, q: Array, v: Array, noise: Sequence[VelocityNoise]) -> list[tuple[Array, Array]]:
        """The smoothed velocity of each joint with `q` and `v` (N, n), and its standard deviation; each (N,)."""
        slope, value = np.zeros_like(q), np.zeros_like(v)
        wanted = {(own.q.memory, True) for own in noise} | {(own.v.memory, False) for own in noise if own.v is not None}
        stds = {key: np.zeros(len(self.time)) for key in wanted - self._stds.keys()}
        every = np.arange(len(self.time))
        for rows in np.split(every, every[CACHED_SAMPLES::CACHED_SAMPLES]):
            of_q, of_v = self._slope(rows), self._value(rows)
            slope[rows], value[rows] = of_q @ q, of_v @ v
            for (memory, of_slope), std in stds.items():
                std[rows] = filtered_std(of_q if of_slope else of_v, self.time, memory)
        for key, std in stds.items():
            make_room(self._stds, CACHED_STDS)
            self._stds[key] = std
        found = []
        for j, own in enumerate(noise):
            share, std = self._share(own)
            smoothed = (1.0 - share) * slope[:, j]
            found.append((smoothed if own.v is None else share * value[:, j] + smoothed, std))
        return found

    def smoother(self, noise: VelocityNoise) -> Velocity:
        """The smoother of a joint, cached."""
        return Velocity.over(self.reach, self.time, noise)

    def rows(self, index: Indices, noise: VelocityNoise) -> Velocity:
        """Rows `index` (K,) of the smoother of a joint, (K, N)."""
        share, std = self._share(noise)
        kept, rest = (sp.diags_array(values[index]) for values in (share, 1.0 - share))
        none = sp.csr_matrix((len(index), len(self.time)))
        from_v = none if noise.v is None else kept @ self._value(index)
        return Velocity(sp.csr_matrix(from_v), sp.csr_matrix(rest @ self._slope(index)), std[index])

    def _slope(self, rows: Indices) -> sp.csr_matrix:
        """(K, N) of positions: the slope at the samples `rows` (K,)."""
        return local_polynomial(self.time, self.reach, 3, 1, at_least=3, rows=rows)

    def _value(self, rows: Indices) -> sp.csr_matrix:
        """(K, N) of velocities: the value at the samples `rows` (K,)."""
        return local_polynomial(self.time, self.reach, 2, 0, at_least=2, rows=rows)

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
            every = np.arange(len(self.time))
            found = filtered_std(self._slope(every) if of_slope else self._value(every), self.time, memory)
            make_room(self._stds, CACHED_STDS)
            self._stds[memory, of_slope] = found
        return self._stds[memory, of_slope]


class _Resting:
    """One joint near rest: how far its windows are widened at each sample."""

    def __init__(self, seen: Array, std: Array, step: float) -> None:
        self.near = maximum_filter1d(
            np.abs(seen) < RESTING_VELOCITY_STDS * std, _samples(RESTING_SMOOTHING_REACHES[-1], step)
        )
        self.narrower = [(seen, AGREEING_VELOCITY_STDS * std)]
        self.index = np.zeros(len(seen), dtype=np.int64)
        """(N,) of the windows chosen, the narrowest being 0."""

    def widen(self, seen: Array, std: Array, samples: int) -> None:
        """Chooses the last windows where wider ones, over `samples`, agree with all narrower ones."""
        # for nested least-squares windows the difference is no noisier than the narrower estimate
        agree = np.all([np.abs(seen - estimate) < limit for estimate, limit in self.narrower], axis=0)
        self.near &= minimum_filter1d(agree, samples)
        self.index[self.near] = len(self.narrower) - 1
        self.narrower.append((seen, AGREEING_VELOCITY_STDS * std))


def _chosen(index: Indices, windows: Sequence[_Fitted], noise: VelocityNoise) -> Velocity:
    """The smoother of a joint, over those of the `windows` at each sample that `index` (N,) tells."""
    places = [np.flatnonzero(index == k) for k in range(len(windows))]
    parts = [fitted.rows(rows, noise) for fitted, rows in zip(windows, places, strict=True) if len(rows)]
    order = np.argsort(np.concatenate(places))
    return Velocity(
        sp.csr_matrix(sp.vstack([part.from_v for part in parts], format="csr")[order]),
        sp.csr_matrix(sp.vstack([part.from_q for part in parts], format="csr")[order]),
        np.concatenate([part.std for part in parts])[order],
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
    return _known(time.tobytes(), reach) if len(time) <= CACHED_SAMPLES else _Fitted(time, reach)


@lru_cache(maxsize=16)
def _known(at: bytes, reach: float) -> _Fitted:
    return _Fitted(np.frombuffer(at), reach)
