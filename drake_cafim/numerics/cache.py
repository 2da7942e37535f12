"""Bounded caches: removal of the oldest entries."""

from typing import Any


def make_room(known: dict[Any, Any], most: int) -> None:
    """Remove the oldest entries of `known` until at most `most` − 1 are left, so that one can be added."""
    while len(known) >= most:
        known.pop(next(iter(known)))
