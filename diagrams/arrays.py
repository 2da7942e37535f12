"""Converts numbers to the array type that Drake's type stubs accept."""

from typing import Any

import numpy as np

from drake_cafim.typing import Array


def as_array(values: Any) -> Array:
    """`values` as an array of floats, shape kept."""
    return np.asarray(values, dtype=float)
