"""Just-in-time compilation of loops over samples, about 100 times as fast as Python; cached on disk."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Any:
    """`function` of floats and arrays, compiled by Numba at its first call.

    Assigning an array to a slice costs two seconds of compiling, for the text of its error: loops cost nothing.
    """
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:
        # no writable cache folder: each process compiles the function again, which takes a second
        return numba.njit(function)
