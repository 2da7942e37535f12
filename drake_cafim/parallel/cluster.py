"""Tasks on a Dask cluster, through the death of workers and of the scheduler."""

import contextlib
import logging
import threading
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.parallel.task import Result, Task, carry_out, died

AHEAD = 4
"""Tasks that the scheduler holds for each thread of the workers: enough that none waits, and far from all of them."""
CONNECTING = 10.0
"""s, longest wait for the scheduler at the start."""
PATIENCE = 300.0
"""s, longest wait for a scheduler that has gone, and for a first worker."""
_ONE_AT_A_TIME = threading.Lock()


def on_cluster(tasks: Sequence[Task], address: str, patience: float = PATIENCE) -> Iterator[Result]:
    """The results as they come, each task's once; carried out by the workers of the Dask scheduler at `address`.

    Dask moves the tasks of a worker that dies to others; one at which more workers died than its setting
    `distributed.scheduler.allowed-failures` (3) is given up. If the scheduler dies, the tasks without a result are
    handed to the one that answers at the same address within `patience` s. Raises `InputError` where Dask is not
    installed, no scheduler answers, or workers cannot run this version.
    """
    done: set[int] = set()
    client = _connected(address, min(CONNECTING, patience))
    try:
        while left := [index for index in range(len(tasks)) if index not in done]:
            _check_workers(client, address, patience)
            try:
                for result in _until_lost(client, tasks, left):
                    if result.index not in done:
                        done.add(result.index)
                        yield result
            except _LostError:
                _close(client)
                client = _connected(address, patience)
    finally:
        _close(client)


class _LostError(Exception):
    """The connection to the scheduler is lost, or the scheduler no longer knows the tasks."""


def run_alone(index: int, task: Task) -> Result:
    """The result of the task; in a worker of several threads, one task at a time."""
    with _ONE_AT_A_TIME:
        return carry_out(index, task)


def _until_lost(client: Any, tasks: Sequence[Task], left: Sequence[int]) -> Iterator[Result]:
    """Results of the tasks `left`; raises `_LostError` when the scheduler is gone."""
    from distributed import as_completed

    waiting = iter(left)
    numbers: dict[str, int] = {}

    def submit(count: int) -> list[Any]:
        futures = []
        for index, _ in zip(waiting, range(count), strict=False):
            future = client.submit(run_alone, index, tasks[index], pure=False, retries=0)
            numbers[future.key] = index
            futures.append(future)
        return futures

    try:
        threads = sum(client.nthreads().values())
        completed = as_completed(submit(max(1, AHEAD * threads)), loop=client.loop)
        for future in completed:
            index = numbers.pop(future.key)
            yield _result_of(future, index, tasks[index])
            completed.update(submit(1))
    except (OSError, TimeoutError) as error:  # Dask's CommClosedError is an OSError
        raise _LostError from error


def _result_of(future: Any, index: int, task: Task) -> Result:
    """The result in a finished future; raises `_LostError` where a dead scheduler cancelled it."""
    from distributed import KilledWorker

    if future.status in ("cancelled", "lost"):
        raise _LostError
    if future.status == "error":
        error = future.exception()
        if isinstance(error, KilledWorker):
            return died(index, task, error.allowed_failures + 1)
        words = " ".join(str(error).split())
        return Result(index, failure=f"{task.name}: {type(error).__name__}: {words}", defect=True)
    result: Result = future.result()
    return result


def _connected(address: str, patience: float) -> Any:
    """A client of the scheduler at `address`, which may take `patience` s to answer."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            f"--scheduler {address}: Dask is not installed, expected `pip install drake_cafim[cluster]`"
        ) from None
    # it logs tracebacks of what is dealt with here
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    until = time.monotonic() + patience
    while True:
        try:
            return Client(address, timeout=min(CONNECTING, patience), set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            if time.monotonic() > until or isinstance(error, ValueError):
                why = " ".join(str(error).split())[:200]
                raise InputError(f"--scheduler {address}: no Dask scheduler answers there ({why})") from None
            time.sleep(1.0)


def _check_workers(client: Any, address: str, patience: float) -> None:
    """Waits for a first worker. Raises `InputError` where there is none, and for one without this version."""
    try:
        client.wait_for_workers(1, timeout=patience)
        found = client.run(_version, on_error="return")
    except TimeoutError:
        raise InputError(f"--scheduler {address}: it has no worker, expected at least one (`dask worker`)") from None
    except OSError:
        return  # it has gone again, which the submission finds out
    for worker, its in found.items():
        if isinstance(its, BaseException):
            raise InputError(f"--scheduler {address}: its worker {worker} cannot import drake_cafim ({its})")
        if its != _version():
            raise InputError(f"--scheduler {address}: its worker {worker} has version {its}, expected {_version()}")


def _version() -> str:
    return version("drake_cafim")


def _close(client: Any) -> None:
    with contextlib.suppress(Exception):  # it may be of a scheduler that is gone
        client.close(timeout=2)
