"""Whitened rows of forces at joints, kept for those that come again.

The slopes of a law that is linear in its strengths are the same at each step of a fit, and in each fit to the same
rows. What is new is whitened together: four columns take about as long as one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.numerics.cache import make_room
from drake_cafim.typing import Array

KEPT = 48
"""Largest number of forces that are kept."""

Forces = tuple[int, Sequence[Array]]
"""The index of a joint, and of each recording the integrals (M, k) of k forces there over the windows."""


@dataclass(frozen=True)
class WhitenedForces:
    """The whitened rows (R, k) of `Forces` over the recordings `runs`, the last ones kept."""

    known: dict[tuple[int, bytes], Array] = field(default_factory=dict, repr=False, compare=False)

    def of(self, runs: Sequence[Run], asked: Sequence[Forces]) -> list[Array]:
        """Those of each of the `asked` forces."""
        keys = [(joint, b"".join(np.ascontiguousarray(part).tobytes() for part in parts)) for joint, parts in asked]
        new = {key: forces for key, forces in zip(keys, asked, strict=True) if key not in self.known}
        found = {key: self.known[key] for key in keys if key in self.known}
        if new:
            widths = [parts[0].shape[1] for _, parts in new.values()]
            rows = np.concatenate([_whitened(run, at, list(new.values())) for at, run in enumerate(runs)])
            found |= zip(new, np.split(rows, np.cumsum(widths)[:-1], axis=1), strict=True)
        for key in new:
            make_room(self.known, KEPT)
            # a copy, so that one that is kept does not keep all
            self.known[key] = found[key] = np.ascontiguousarray(found[key])
        return [found[key] for key in keys]


def _whitened(run: Run, at: int, forces: Sequence[Forces]) -> Array:
    """The whitened rows (R, k) of the recording with index `at` by all `forces`."""
    windows, r = run.shape
    columns = []
    for joint, parts in forces:
        rows = np.zeros((windows, r, parts[at].shape[1]))
        rows[:, run.weak.dynamic.start + joint] = parts[at]
        columns.append(rows)
    return run.whitened(np.concatenate(columns, axis=2))
