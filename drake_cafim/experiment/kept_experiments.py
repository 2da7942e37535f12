"""Experiments that are finished, on disk, so that a run that was ended goes on with the next one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from pydrake.systems.framework import Context, System

from drake_cafim.kept import Kept
from drake_cafim.typing import Array

Logs: TypeAlias = tuple[dict[str, Array], dict[str, Array]]
"""What an experiment leaves, by name: its rows, one for each end of a period, and what the world recorded."""
KINDS = ("row", "recorded")
STATE = "state"


@dataclass(frozen=True)
class KeptExperiments:
    """Experiments among what is `kept`, and after each the state of the `lasting` systems of the run's Diagram.

    All other systems begin each experiment anew.
    """

    kept: Kept
    lasting: Sequence[System]

    def read(self, number: int, root: Context) -> Logs | None:
        """The logs of experiment `number`, with the state after it set in `root`; None where it is not kept."""
        return self.kept.read_arrays(_name(number), lambda arrays: self._take_up(root, arrays))

    def write(self, number: int, root: Context, logs: Logs) -> None:
        """Keep the logs of experiment `number`, and the state in `root`."""
        parts = zip(KINDS, logs, strict=True)
        named = {f"{kind} {name}": values for kind, part in parts for name, values in part.items()}
        self.kept.write_arrays(_name(number), {STATE: np.concatenate(self._vectors(root)), **named})

    def _vectors(self, root: Context) -> list[Array]:
        vectors = []
        for system in self.lasting:
            state: Any = system.GetMyContextFromRoot(root).get_discrete_state()
            vectors += [np.array(state.get_vector(index).get_value()) for index in range(state.num_groups())]
        return vectors

    def _take_up(self, root: Context, arrays: Mapping[str, Array]) -> Logs:
        """Raises `ValueError` where the arrays are of another Diagram."""
        sizes = [len(vector) for vector in self._vectors(root)]
        if arrays[STATE].shape != (sum(sizes),):
            raise ValueError(f"a state of {arrays[STATE].shape} numbers, expected {sum(sizes)}")
        vectors: Any = iter(np.split(arrays[STATE], np.cumsum(sizes)[:-1]))
        for system in self.lasting:
            state: Any = system.GetMyMutableContextFromRoot(root).get_mutable_discrete_state()
            for index in range(state.num_groups()):
                state.get_mutable_vector(index).SetFromVector(next(vectors))
        rows, recorded = (
            {name.removeprefix(f"{kind} "): each for name, each in arrays.items() if name.startswith(f"{kind} ")}
            for kind in KINDS
        )
        return rows, recorded


def _name(number: int) -> str:
    return f"experiment_{number + 1}"
