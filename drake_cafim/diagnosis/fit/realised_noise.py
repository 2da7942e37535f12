"""Whitened rows that noise alone makes, where it is not Gaussian, and how a statistic of them is distributed."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.numerics.tail import Tail
from drake_cafim.typing import Array


@dataclass(frozen=True, eq=False)
class RealisedNoise:
    """K realisations of the noise in the whitened `rows` (R, K) of a problem."""

    rows: Array
    _tails: dict[str, Tail] = field(default_factory=dict, repr=False)
    """Cache: the tail of each statistic, by its name."""

    def tail(self, statistic: Callable[[Array], float]) -> Tail:
        """The tail of a `statistic` of rows (R,), a function with a name of its own."""
        name = statistic.__name__
        if name not in self._tails:
            self._tails[name] = Tail.of(np.array([statistic(rows) for rows in self.rows.T]))
        return self._tails[name]
