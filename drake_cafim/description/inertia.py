"""Rotational inertias that no body can have, and the nearest that one can."""

import numpy as np

from drake_cafim.typing import Array

SLACK = 1e-9
"""Share of the largest moment by which rounding may break the rule."""


def breaks_the_rule(inertia: Array) -> bool:
    """Whether a principal moment of `inertia` (3, 3) is more than the sum of the others, or negative."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    return bool(low + middle - high < -SLACK * abs(high) or low < -SLACK * abs(high))


def mended(inertia: Array) -> Array:
    """The inertia (3, 3) with principal moments that a body can have, as near as possible.

    Negative ones become zero; the excess of the largest over the other two is shared by the three, which is the
    projection on low + middle = high.
    """
    moments, axes = np.linalg.eigh(inertia)
    moments = np.maximum(moments, 0.0)
    excess = max(0.0, moments[2] - moments[0] - moments[1])
    moments = moments + excess / 3.0 * np.array([1.0, 1.0, -1.0])
    return np.asarray(axes @ np.diag(moments) @ axes.T, dtype=float)
