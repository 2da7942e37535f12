"""Processes that end when the one that made them does, however that ends."""

import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

LOOKING = 0.5
"""s between two looks at whether the process that made this one is there."""


def end_with(parent: int) -> None:
    """End this process when `parent` does, the process that made it.

    Killed, that leaves the processes that it made: they would go on, or wait for ever, and hold its locks.
    """

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(LOOKING)
        os._exit(1)

    threading.Thread(target=look, daemon=True).start()


@contextmanager
def ending_at_errors() -> Iterator[None]:
    """End the processes that multiprocessing made in this block where an exception leaves it, as at Ctrl-C."""
    others = multiprocessing.active_children()
    try:
        yield
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in others:
                process.kill()
        raise
