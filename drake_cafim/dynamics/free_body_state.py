"""Batches of states of a free body: pose, velocity and angular velocity."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.typing import Array, Flags, Indices


@dataclass(frozen=True)
class State:
    """B states as `numbers` (B, 13): p, quaternion, v, w, all in the world frame."""

    numbers: Array

    @classmethod
    def of(cls, p: Array, quaternion: Array, v: Array, w: Array) -> "State":
        """From p (B, 3) m, quaternion (B, 4), v (B, 3) m/s and w (B, 3) rad/s."""
        return cls(np.concatenate([p, quaternion, v, w], axis=1))

    @property
    def p(self) -> Array:
        """p_WB (B, 3) m, the position of the body's origin."""
        return self.numbers[:, :3]

    @property
    def quaternion(self) -> Array:
        """R_WB as quaternions (w, x, y, z), (B, 4)."""
        return self.numbers[:, 3:7]

    @property
    def v(self) -> Array:
        """v_WB (B, 3) m/s, the velocity of the body's origin."""
        return self.numbers[:, 7:10]

    @property
    def w(self) -> Array:
        """w_WB (B, 3) rad/s, the angular velocity."""
        return self.numbers[:, 10:]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, rows: Any) -> "State":
        return State(self.numbers[rows])


def normalise(state: State) -> State:
    """The states with quaternions scaled to unit length, in place."""
    q = state.quaternion
    q /= np.sqrt((q * q).sum(axis=1))[:, None]
    return state


def stack(states: "list[State]") -> State:
    """The states of all batches, concatenated."""
    return State(np.concatenate([batch.numbers for batch in states]))


def select(which: Flags, states: State, other: State) -> State:
    """`states` where `which` (B,) is True, `other` elsewhere."""
    return State(np.where(which[:, None], states.numbers, other.numbers))


def replace_rows(states: State, rows: Indices, other: State) -> State:
    """A copy of `states` (B) with `other` (K) at the indices `rows` (K,)."""
    numbers = states.numbers.copy()
    numbers[rows] = other.numbers
    return State(numbers)


@dataclass(frozen=True)
class Moment:
    """The times of states, `time` (B,) s, and the index (B,) of their recording among `names`."""

    time: Array
    recording: Indices
    names: tuple[str, ...]

    def __getitem__(self, rows: Any) -> "Moment":
        return Moment(self.time[rows], self.recording[rows], self.names)
