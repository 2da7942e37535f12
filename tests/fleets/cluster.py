"""A real Dask scheduler with workers on this machine, each a process of its own that can be killed."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Cluster:
    """A scheduler on a free port of the loopback interface, and its workers of one thread."""

    def __init__(self, workers: int) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        self.workers = [self.add_worker() for _ in range(workers)]

    def _start(self, kind: str, *arguments: str) -> subprocess.Popen[bytes]:
        # tasks of tests are imported from the checkout; threads of BLAS would compete with the other worker
        environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        line = [sys.executable, "-m", "dask", kind, *arguments, "--no-dashboard"]
        return subprocess.Popen(line, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def add_worker(self) -> subprocess.Popen[bytes]:
        """A worker with a nanny, which starts its process again if it dies."""
        return self._start("worker", self.address, "--nthreads", "1", "--host", "127.0.0.1")

    def kill_worker(self, number: int) -> None:
        """Kill a worker's process, not its nanny."""
        import psutil

        children = psutil.Process(self.workers[number].pid).children(recursive=True)
        for child in children:
            if "resource_tracker" not in " ".join(child.cmdline()):
                child.kill()

    def restart_scheduler(self) -> None:
        """Kill the scheduler, and start one at the same address with new workers."""
        self._end()
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        self.workers = [self.add_worker() for _ in self.workers]

    def _end(self) -> None:
        import psutil

        for process in [*self.workers, self.scheduler]:
            family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
            for child in family:
                child.kill()
            process.kill()
            process.wait()


@contextmanager
def cluster(workers: int = 2) -> Iterator[Cluster]:
    """A cluster that ends with the block."""
    started = Cluster(workers)
    try:
        yield started
    finally:
        started._end()
