"""One joint's motion and effort over a recording, and a force there with its derivatives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.effects.bristle import bristle_along
from drake_cafim.effects.mean_sign import MeanSign
from drake_cafim.typing import Array, Indices

SIGNS = 12
"""How many widths of the smoothed sign function are cached with one joint's samples."""


@dataclass(frozen=True)
class JointSamples:
    """One joint's motion and effort, each (N,): rad or m, rad/s or m/s, N m or N."""

    q: Array
    v: Array
    u: Array
    v_std: Array | float = 0.0
    """Standard deviation of v; a force that is strongly nonlinear in v is averaged over this error."""
    q_reach: Array | float = 0.0
    """Distance that q moves within half a sample interval; a force with an onset in that range is averaged over it."""
    load: Array | float = 0.0
    """The effort by gravity and contacts at the joint, N m or N; 0 unless a law depends on it."""
    bristles: Mapping[float, Array] | None = None
    """The states z of friction that builds up over a displacement, by the displacement, where they are known."""
    in_order: bool = False
    """Whether the samples are a path, one after another, along which such a state can be followed."""
    _signs: dict[float, MeanSign] = field(default_factory=dict, init=False, repr=False, compare=False)

    def sign(self, width: float) -> MeanSign:
        """The mean of tanh(v/`width`) over v's error; the results for the last `SIGNS` widths are cached."""
        if width not in self._signs:
            while len(self._signs) >= SIGNS:
                self._signs.pop(next(iter(self._signs)))
            self._signs[width] = MeanSign.of(self.v, self.v_std, width)
        return self._signs[width]

    def bent(self, slip: float) -> Array | None:
        """(N,) the state z of a friction that builds up over `slip`, rad or m; None where the past is not known."""
        if self.bristles is not None:
            return self.bristles[slip]
        return bristle_along(self.q, slip) if self.in_order else None

    def at(self, which: Indices) -> "JointSamples":
        """Those samples that are `which`, not known to be a path."""
        bristles = None if self.bristles is None else {slip: z[which] for slip, z in self.bristles.items()}
        v_std, q_reach, load = (
            np.broadcast_to(values, self.q.shape)[which] for values in (self.v_std, self.q_reach, self.load)
        )
        return JointSamples(self.q[which], self.v[which], self.u[which], v_std, q_reach, load, bristles)

    def under(self, u: Array, load: Array | float) -> "JointSamples":
        """The samples with the efforts `u` (N,) and the `load` (N,), N m or N; the cached signs are shared."""
        changed = replace(self, u=u, load=load)
        object.__setattr__(changed, "_signs", self._signs)
        return changed

    def with_velocity_change(self, by: Array) -> "JointSamples":
        """The samples with velocities changed `by` (N,) rad/s or m/s."""
        return replace(self, v=self.v + by)


def concatenate(samples: Sequence[JointSamples]) -> JointSamples:
    """The samples of several recordings, concatenated."""
    names = ("q", "v", "u", "v_std", "q_reach", "load")
    q, v, u, v_std, q_reach, load = (
        np.concatenate([np.broadcast_to(getattr(part, name), part.q.shape) for part in samples]) for name in names
    )
    return JointSamples(q, v, u, v_std, q_reach, load)


@dataclass(frozen=True)
class Force:
    """A generalized force and its derivatives: `value`, `d_q`, `d_v`, `d_u` (N,), `d_strengths` (N, k)."""

    value: Array
    d_q: Array
    d_v: Array
    d_u: Array
    d_strengths: Array


def joined_forces(parts: Sequence[Force]) -> Force:
    """The forces on the samples of several `parts`, one part after another."""
    names = ("value", "d_q", "d_v", "d_u", "d_strengths")
    return Force(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
