"""The onset of a force at zero depth (contact, hard stop), averaged over a sample interval."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

LEAST = 1e-12
"""Smallest reach, so that a division by it is finite."""
FREE = 0.02
"""Least fraction of samples out of contact: a contact or stop that is never left is a spring."""


@dataclass(frozen=True)
class Onset:
    """Averages over x uniform in depth ± reach: `share` (N,), that of x > 0, and `depth` (N,), the mean of max(x, 0).

    Without the average a force that starts with a jump, as a damper's, would start up to half a sample early or late.
    """

    share: Array
    depth: Array
    slope: Array
    """∂share/∂depth (N,); the derivative of the mean max(x, 0) is `share`."""

    @classmethod
    def of(cls, depth: Array, reach: Array | float) -> "Onset":
        """For depths (N,), negative out of contact, and half the distance travelled in a sample interval."""
        reach = np.maximum(reach, LEAST)
        share = np.clip(0.5 * (1.0 + depth / reach), 0.0, 1.0)
        passing = np.abs(depth) < reach
        mean = np.where(passing, reach * share**2, np.maximum(depth, 0.0))
        return cls(share, mean, np.where(passing, 0.5 / reach, 0.0))
