"""Vectors in and out of ports, typed."""

from typing import Any, cast

import numpy as np
from pydrake.systems.framework import Context, InputPort

from drake_cafim.typing import Array


def read(port: InputPort, context: Context) -> Array:
    """A copy of the vector at the port."""
    return np.array(cast(Array, port.Eval(context)), dtype=float)


def remembered(context: Context) -> Array:
    """A copy of discrete state 0."""
    return np.array(context.get_discrete_state(0).get_value(), dtype=float)


def array(values: Any) -> Array:
    """The values as Drake's typed calls want them."""
    return np.asarray(values, dtype=float)
