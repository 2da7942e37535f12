"""Statistics of an executed motion: counts of reversals and of contact changes."""

import numpy as np

from drake_cafim.typing import Array


def count_reversals(velocity: Array) -> int:
    """Number of sign changes of velocity (T,) after which the new sign lasts for two samples or more."""
    signs = np.sign(velocity)
    signs = signs[signs != 0]
    current, count = 0.0, 0
    for index in range(len(signs) - 1):
        if signs[index] == signs[index + 1] and signs[index] != current:
            count += current != 0.0
            current = signs[index]
    return int(count)


def count_make_breaks(touching: Array) -> int:
    """Number of changes between contact and no contact in `touching` (T,) bool."""
    return int(np.count_nonzero(np.diff(np.asarray(touching, dtype=int))))
