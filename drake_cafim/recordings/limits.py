"""Limits on what a file may claim to hold, checked before memory is taken for it."""

from pathlib import Path

from drake_cafim.errors import InputError

MOST_COLUMNS = 10_000
"""Largest number of columns, topics or arrays; a robot with a hand has some hundred."""
SMALL = 64 * 2**20
"""bytes; tables up to here are read, however well they are compressed."""
DENSEST = 200
"""Largest ratio of the table's size in memory to the file's; recordings of a robot at rest reach about 50."""


def check_columns(name: str, count: int) -> None:
    """Raises `InputError` for more than `MOST_COLUMNS` columns."""
    if count > MOST_COLUMNS:
        raise InputError(f"{name}: it has {count} columns, expected at most {MOST_COLUMNS}")


def check_size(path: Path, claimed: int) -> None:
    """Raises `InputError` where `claimed` bytes of numbers are too many for a file of that size.

    A damaged header claims any number, and a file of a megabyte can unpack to gigabytes of zeros.
    """
    there = path.stat().st_size
    if claimed > SMALL + DENSEST * there:
        raise InputError(
            f"{path}: it claims {claimed / 2**20:.4g} MiB of numbers in a file of {there / 2**20:.3g} MiB, expected at "
            f"most {DENSEST} times its size"
        )
