"""`python -m tests.fleets.faults`: what is lost, done twice or left half on a Dask cluster when something fails."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drake_cafim.parallel.cluster import on_cluster
from drake_cafim.parallel.processes import on_processes
from drake_cafim.parallel.task import Result, Task

from .cluster import Cluster, cluster
from .faulty import cannot_write, die, die_once, write_line

TASKS = 40
Event = Callable[[Cluster], None]


@dataclass(frozen=True)
class Outcome:
    """What became of the tasks: results, those lost and those told twice, failures by their index, files left half."""

    results: int
    lost: int
    twice: int
    half: int
    failures: dict[int, str]
    seconds: float

    def as_text(self) -> str:
        counts = f"{self.results:3} results, {self.lost} lost, {self.twice} twice, {self.half} half"
        return f"{counts}, {self.seconds:4.0f} s; " + ("; ".join(self.failures.values()) or "no failure")


def tasks(folder: Path, special: dict[int, Callable[[Path, int], int]] | None = None) -> list[Task]:
    """Tasks that leave a file each; those of `special` are carried out by another function."""
    return [Task(f"task {k}", (special or {}).get(k, write_line), (folder, k)) for k in range(TASKS)]


def outcome(found: list[Result], folder: Path, seconds: float) -> Outcome:
    indices = [result.index for result in found]
    failures = {result.index: result.failure for result in found if result.failure}
    missing = [k for k in set(indices) - set(failures) if not (folder / f"{k}.result").is_file()]
    lost = TASKS - len(set(indices)) + len(missing)
    return Outcome(len(found), lost, len(indices) - len(set(indices)), len([*folder.glob("*.part")]), failures, seconds)


def on_dask(
    special: dict[int, Callable[[Path, int], int]] | None = None, event: Event | None = None, after: int = 10
) -> Outcome:
    """The tasks on a cluster with two workers; `event` happens after so many results."""
    with tempfile.TemporaryDirectory() as scratch, cluster() as dask:
        started, found = time.perf_counter(), []
        for result in on_cluster(tasks(Path(scratch), special), dask.address):
            found.append(result)
            if event is not None and len(found) == after:
                event(dask)
        return outcome(found, Path(scratch), time.perf_counter() - started)


def on_this_machine(special: dict[int, Callable[[Path, int], int]]) -> Outcome:
    """The tasks on two processes of joblib's."""
    with tempfile.TemporaryDirectory() as scratch:
        started = time.perf_counter()
        found = list(on_processes(tasks(Path(scratch), special), 2))
        return outcome(found, Path(scratch), time.perf_counter() - started)


CASES: dict[str, Callable[[], Outcome]] = {
    "nothing fails": on_dask,
    "a worker is killed": lambda: on_dask(event=lambda dask: dask.kill_worker(0)),
    "the scheduler is restarted": lambda: on_dask(event=lambda dask: dask.restart_scheduler()),
    "a result cannot be written": lambda: on_dask({7: cannot_write}),
    "a task dies every time": lambda: on_dask({7: die}),
    "a task dies once, on processes": lambda: on_this_machine({7: die_once}),
    "a task dies every time, on processes": lambda: on_this_machine({7: die, 9: cannot_write}),
}


def main() -> int:
    bad = 0
    for name, case in CASES.items():
        found = case()
        bad += found.lost + found.twice + found.half
        print(f"{name:37} {found.as_text()}", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
