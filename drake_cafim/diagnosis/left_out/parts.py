"""Parts of the training recordings that are left out in turn: whole recordings, or quarters of a single one."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drake_cafim.diagnosis.fit.problem import Rows
from drake_cafim.typing import Array, Flags

MOST_PARTS = 4
"""Most parts: a single recording has so many, and more recordings than that are left out in groups."""


@dataclass(frozen=True)
class Part:
    """What is left out at once: the `recordings` with these numbers, from `begin` to before `end`, s."""

    recordings: tuple[int, ...]
    begin: float = -np.inf
    end: float = np.inf

    def holds(self, time: Array) -> Flags:
        """(N,) whether each `time`, s, of one of its recordings is in it."""
        return np.asarray((time >= self.begin) & (time < self.end))

    def rows(self, runs: Sequence[Rows]) -> Flags:
        """(R,) which of the whitened rows of all `runs` are in it.

        A whitened row is the innovation of its window given all earlier ones, so that leaving some out leaves the
        likelihood of the others, given what was before them.
        """
        own = [
            np.repeat(self.holds(run.time), run.shape[1]) if k in self.recordings else np.zeros(run.rows, dtype=bool)
            for k, run in enumerate(runs)
        ]
        return np.concatenate(own)


def parts_of(runs: Sequence[Rows]) -> tuple[Part, ...]:
    """The parts of the recordings `runs`."""
    if len(runs) == 1:
        edges = np.quantile(runs[0].time, np.arange(1, MOST_PARTS) / MOST_PARTS)
        bounds = [-np.inf, *map(float, edges), np.inf]
        return tuple(Part((0,), begin, end) for begin, end in pairwise(bounds))
    groups = np.array_split(np.arange(len(runs)), min(MOST_PARTS, len(runs)))
    return tuple(Part(tuple(int(k) for k in group)) for group in groups)
