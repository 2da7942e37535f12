"""Carries out tasks where the command line says: on this machine's processes, or on a Dask cluster."""

from collections.abc import Iterator, Sequence

from drake_cafim.parallel.cluster import on_cluster
from drake_cafim.parallel.processes import on_processes
from drake_cafim.parallel.task import Result, Task


def distribute(tasks: Sequence[Task], jobs: int = -1, scheduler: str | None = None) -> Iterator[Result]:
    """The result of each task, once, as they come: on `jobs` processes, or on the cluster of the Dask `scheduler`.

    Neither an exception in a task nor the death of its process ends the others. Raises `InputError` for a scheduler
    that cannot be used.
    """
    return on_cluster(tasks, scheduler) if scheduler else on_processes(tasks, jobs)
