"""Physical consistency of rotational inertias: the test, and the nearest consistent inertia."""

import numpy as np

from drake_cafim.typing import Array

SLACK = 1e-9
"""Tolerance of the test, as a share of the largest moment: files hold rounded numbers."""


def is_unphysical(inertia: Array) -> bool:
    """Whether a principal moment of `inertia` (3, 3) is negative or exceeds the sum of the others: no body has such."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    return bool(low + middle - high < -SLACK * abs(high) or low < -SLACK * abs(high))


def nearest_physical_inertia(inertia: Array) -> Array:
    """A physically consistent inertia (3, 3) near `inertia`, with the same principal axes.

    Negative principal moments become zero; then the excess e = high − low − middle, if positive, is shared,
    (low + e/3, middle + e/3, high − e/3), which is the orthogonal projection on low + middle = high.
    """
    moments, axes = np.linalg.eigh(inertia)
    moments = np.maximum(moments, 0.0)
    excess = max(0.0, moments[2] - moments[0] - moments[1])
    moments = moments + excess / 3.0 * np.array([1.0, 1.0, -1.0])
    return np.asarray(axes @ np.diag(moments) @ axes.T, dtype=float)
