"""Room among what is kept of what was reckoned last."""

from typing import Any


def make_room(known: dict[Any, Any], most: int) -> None:
    """Forget the oldest of `known`, until one more makes no more than `most`."""
    while len(known) >= most:
        known.pop(next(iter(known)))
