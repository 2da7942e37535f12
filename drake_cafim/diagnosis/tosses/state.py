"""Where free bodies are and how they move, many at once."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.typing import Array, Flags, Indices


@dataclass(frozen=True)
class State:
    """B states, `numbers` (B, 13) of each; in the world."""

    numbers: Array

    @classmethod
    def of(cls, p: Array, quaternion: Array, v: Array, w: Array) -> "State":
        """From the parts (B, 3), (B, 4), (B, 3) and (B, 3)."""
        return cls(np.concatenate([p, quaternion, v, w], axis=1))

    @property
    def p(self) -> Array:
        """(B, 3) m, the origin."""
        return self.numbers[:, :3]

    @property
    def quaternion(self) -> Array:
        """(B, 4)"""
        return self.numbers[:, 3:7]

    @property
    def v(self) -> Array:
        """(B, 3) m/s, of the origin."""
        return self.numbers[:, 7:10]

    @property
    def w(self) -> Array:
        """(B, 3) rad/s"""
        return self.numbers[:, 10:]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, rows: Any) -> "State":
        return State(self.numbers[rows])


def upright(state: State) -> State:
    """The states, their quaternions made of unit length; in place."""
    q = state.quaternion
    q /= np.sqrt((q * q).sum(axis=1))[:, None]
    return state


def stacked(states: "list[State]") -> State:
    """The states one after the other."""
    return State(np.concatenate([one.numbers for one in states]))


def picked(first: Flags, one: State, other: State) -> State:
    """The states of `one` where `first` (B,) says so, and those of `other` elsewhere."""
    return State(np.where(first[:, None], one.numbers, other.numbers))


def replaced(states: State, rows: Indices, other: State) -> State:
    """`states` (B) with those of `other` (K) in `rows` (K,)."""
    numbers = states.numbers.copy()
    numbers[rows] = other.numbers
    return State(numbers)


@dataclass(frozen=True)
class Moment:
    """When and where states were: `time` (B,) s, and the index (B,) of their recording among `names`."""

    time: Array
    recording: Indices
    names: tuple[str, ...]

    def __getitem__(self, rows: Any) -> "Moment":
        return Moment(self.time[rows], self.recording[rows], self.names)
