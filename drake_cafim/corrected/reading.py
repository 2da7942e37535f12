"""Typed access to the vectors of ports and discrete states."""

from typing import Any, cast

import numpy as np
from pydrake.systems.framework import Context, InputPort

from drake_cafim.typing import Array


def read(port: InputPort, context: Context) -> Array:
    """A copy of the input port's value."""
    return np.array(cast(Array, port.Eval(context)), dtype=float)


def discrete_state(context: Context) -> Array:
    """A copy of discrete state 0."""
    return np.array(context.get_discrete_state(0).get_value(), dtype=float)


def array(values: Any) -> Array:
    """The values as an array of floats, the type of Drake's stubs."""
    return np.asarray(values, dtype=float)
