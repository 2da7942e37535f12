"""What sets in at a depth, averaged over the time that a sample stands for."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

LEAST = 1e-12
FREE = 0.02
"""Least share of the time in which what sets in at a depth has not: a contact that is never left is a spring."""


@dataclass(frozen=True)
class Onset:
    """Of a passage from depth − reach to depth + reach: the `share` (N,) of it beyond zero, and the mean of x₊ (N,).

    A force that starts with a jump, as a damper's does, would otherwise come half a sample early or late.
    """

    share: Array
    depth: Array
    slope: Array
    """∂share/∂depth; that of the mean depth is the share."""

    @classmethod
    def of(cls, depth: Array, reach: Array | float) -> "Onset":
        reach = np.maximum(reach, LEAST)
        share = np.clip(0.5 * (1.0 + depth / reach), 0.0, 1.0)
        passing = np.abs(depth) < reach
        mean = np.where(passing, reach * share**2, np.maximum(depth, 0.0))
        return cls(share, mean, np.where(passing, 0.5 / reach, 0.0))
