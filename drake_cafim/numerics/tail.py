"""The upper tail of a distribution, from draws of it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drake_cafim.typing import Array

SHARE = 0.1
"""Share of the draws that are taken for the tail."""


@dataclass(frozen=True)
class Tail:
    """P(X > x) = `SHARE` e^−(x − threshold)/scale: what is beyond a threshold is exponential.

    That is the limit for thin tails (Pickands, Annals of Statistics 3(1), 1975); the scale is the mean excess.
    """

    threshold: float
    scale: float

    @classmethod
    def of(cls, draws: Array) -> Self:
        """The tail of `draws` (K,)."""
        threshold = float(np.quantile(draws, 1.0 - SHARE))
        return cls(threshold, float(np.mean(draws[draws > threshold]) - threshold))

    def probability(self, value: float) -> float:
        """P(X > value); near the middle of the distribution too large, at most 1."""
        return float(min(1.0, SHARE * np.exp(min((self.threshold - value) / self.scale, 700.0))))

    def level(self, probability: float) -> float:
        """The value that X exceeds with this `probability`."""
        return self.threshold + self.scale * float(np.log(SHARE / probability))
