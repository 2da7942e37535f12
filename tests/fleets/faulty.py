"""Tasks of a cluster test: each leaves a line in a file for each time it was carried out."""

from __future__ import annotations

import os
import time
from pathlib import Path


def write_line(folder: Path, number: int, seconds: float = 0.05) -> int:
    """Note that the task was carried out; replaces what an earlier attempt left, as a diagnosis does."""
    time.sleep(seconds)
    with open(folder / f"{number}.log", "a") as log:
        log.write("done\n")
    part = folder / f"{number}.part"
    part.write_text(str(number))
    part.replace(folder / f"{number}.result")
    return number


def die(folder: Path, number: int) -> int:
    """End the process, every time."""
    os._exit(9)


def die_once(folder: Path, number: int) -> int:
    """End the process the first time."""
    mark = folder / f"{number}.died"
    if not mark.exists():
        mark.write_text("once")
        os._exit(9)
    return write_line(folder, number)


def cannot_write(folder: Path, number: int) -> int:
    """A result whose folder is not there."""
    return write_line(folder / "not there", number)
