"""Loops over samples that a compiler runs a hundred times as fast as Python, and kept for the next process."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Any:
    """`function` of floats and arrays, compiled at its first call."""
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:
        # nowhere to keep it: each process compiles it anew, which takes a second
        return numba.njit(function)
