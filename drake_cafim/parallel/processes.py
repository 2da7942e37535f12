"""Tasks on processes of this machine, by joblib's executor; a process that dies costs its own task alone."""

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from joblib import effective_n_jobs
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool, TerminatedWorkerError

from drake_cafim.parallel.ending import end_with
from drake_cafim.parallel.task import ATTEMPTS, Result, Task, carry_out, died

AHEAD = 2
"""Tasks that wait in the executor for each process, so that none is idle."""


def on_processes(tasks: Sequence[Task], jobs: int) -> Iterator[Result]:
    """The results as they come; `jobs` processes, -1 for one per core; with one job, in this process.

    If a process dies, the executor loses all that is running. Those tasks are then carried out one at a time, so that
    the one that kills its process is known; after `ATTEMPTS` it is given up.
    """
    count = effective_n_jobs(jobs)
    if count == 1 or len(tasks) < 2:
        yield from (carry_out(index, task) for index, task in enumerate(tasks))
        return
    waiting = deque(range(len(tasks)))
    attempts = dict.fromkeys(waiting, 0)
    try:
        while waiting:
            suspects = yield from _until_one_dies(tasks, waiting, count)
            for index in suspects:
                yield _alone(tasks, index, attempts)
    except BaseException:  # Ctrl-C, or whoever took the results no longer does
        _executor(count).shutdown(kill_workers=True)
        raise


def _until_one_dies(tasks: Sequence[Task], waiting: "deque[int]", count: int) -> Any:
    """Yields results; returns the indices of the tasks that were running when a process died, none at the end."""
    executor = _executor(count)
    running: dict[Future[Result], int] = {}
    lost: list[int] = []
    while waiting or running:
        while waiting and len(running) < AHEAD * count and not lost:
            index = waiting.popleft()
            try:
                running[executor.submit(carry_out, index, tasks[index])] = index
            except (BrokenProcessPool, TerminatedWorkerError):
                lost.append(index)
        if not running:
            break
        finished, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in finished:
            index = running.pop(future)
            try:
                yield future.result()
            except (BrokenProcessPool, TerminatedWorkerError):
                lost.append(index)
    return sorted(lost)


def _alone(tasks: Sequence[Task], index: int, attempts: dict[int, int]) -> Result:
    """The result of a task in an executor of one process, which is started anew if it dies."""
    while attempts[index] < ATTEMPTS - 1:  # the first attempt was among others
        attempts[index] += 1
        executor = _executor(1)
        try:
            result: Result = executor.submit(carry_out, index, tasks[index]).result()
            return result
        except (BrokenProcessPool, TerminatedWorkerError):
            continue
    return died(index, tasks[index])


def _executor(count: int) -> Any:
    return get_reusable_executor(max_workers=count, initializer=end_with, initargs=(os.getpid(),))
