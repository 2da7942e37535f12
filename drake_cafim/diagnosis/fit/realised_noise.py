"""Whitened rows that noise alone makes, where it is not Gaussian, and the tail of the tests of fit on them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.numerics.tail import Tail
from drake_cafim.typing import Array


@dataclass(frozen=True, eq=False)
class RealisedNoise:
    """K realisations of the noise in the whitened `rows` (R, K) of a problem."""

    rows: Array
    _tail: list[Tail] = field(default_factory=list, repr=False)
    """Cache: the tail."""

    def tail(self, surprise: Callable[[Array], float]) -> Tail:
        """The tail of −ln p of the tests of fit, `surprise` of rows (R,); it is always the same function."""
        if not self._tail:
            self._tail.append(Tail.of(np.array([surprise(rows) for rows in self.rows.T])))
        return self._tail[0]
