"""Just-in-time compilation of loops over samples, about 100 times as fast as Python; cached on disk."""

from collections.abc import Callable
from typing import Any

import numba

ANY_ORDER = frozenset({"reassoc", "contract", "nsz"})
"""What lets a compiler add the terms of a sum in any order; numbers that are not finite stay what they are."""


def compiled(function: Callable[..., Any]) -> Any:
    """`function` of floats and arrays, compiled by Numba at its first call.

    Assigning an array to a slice costs two seconds of compiling, for the text of its error: loops cost nothing.
    """
    return _compiled(function, frozenset())


def compiled_sums(function: Callable[..., Any]) -> Any:
    """`compiled`, with the terms of sums added in any order, several of them at once."""
    return _compiled(function, ANY_ORDER)


def _compiled(function: Callable[..., Any], allowed: frozenset[str]) -> Any:
    try:
        return numba.njit(cache=True, fastmath=set(allowed))(function)
    except RuntimeError:
        # no writable cache folder: each process compiles the function again, which takes a second
        return numba.njit(fastmath=set(allowed))(function)
