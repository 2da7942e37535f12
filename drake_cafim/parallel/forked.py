"""Many small results of one function on copies of this process, which share what it has in memory.

For work on objects that cannot be sent to another process, as a scene with Drake's own: a fork has them already.
"""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from pickle import PicklingError
from typing import Any, TypeVar

from joblib import effective_n_jobs

from drake_cafim.parallel.ending import end_with, ending_at_errors

Found = TypeVar("Found")
AHEAD = 2
"""Calls that wait for each process, so that none is idle."""
_function: list[Callable[[int], Any]] = []
"""What the copies call; a fork inherits it."""
_in_copy: list[bool] = []
"""Not empty in a copy, which makes no copies of its own: the cores are busy."""


def map_forked(function: Callable[[int], Found], count: int, jobs: int = 1) -> Iterator[Found]:
    """function(0), function(1), ... in this order, by `jobs` copies of this process, -1 for one per core.

    What it changes in memory is lost with the copies; with one job it is called here, as it is in a copy, and where
    what it returned cannot be sent to this process, as an object of a class that only a running program knows. Its
    exceptions are passed on.
    """
    workers = min(effective_n_jobs(jobs), count)
    if workers < 2 or _in_copy or "fork" not in multiprocessing.get_all_start_methods():
        yield from map(function, range(count))
        return
    _function.append(function)
    try:
        fork = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(workers, fork, _begin, (os.getpid(),)) as executor, ending_at_errors():
            waiting: deque[tuple[int, Future[Found]]] = deque()
            for number in range(count):
                waiting.append((number, executor.submit(_call, number)))
                if len(waiting) > AHEAD * workers:
                    yield _result(function, *waiting.popleft())
            while waiting:
                yield _result(function, *waiting.popleft())
    finally:
        _function.pop()


def _result(function: Callable[[int], Found], number: int, sent: "Future[Found]") -> Found:
    try:
        return sent.result()
    except (PicklingError, AttributeError, TypeError):
        # how an object that cannot be sent is told; what the function itself raised, it raises again
        return function(number)


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C is the parent's to answer
    end_with(parent)
    _in_copy.append(True)


def _call(number: int) -> Any:
    return _function[-1](number)
