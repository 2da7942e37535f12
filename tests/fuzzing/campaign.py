"""Inputs tried one after the other in forked processes, which are watched for hangs, crashes and memory."""

import json
import mmap
import os
import resource
import shutil
import signal
import struct
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

HANG = 10.0
"""s of the process's own computing, unless the inputs have a `hang`: the clock on the wall says nothing on a
busy machine."""
STUCK = 1200  # s on the wall: a busy machine may hold an input up a hundredfold
MEMORY = 2**30  # bytes above what the process had before
BATCH = 200


class Cases(Protocol):
    """Inputs by number."""

    def run(self, number: int, folder: Path) -> str:
        """What becomes of the input, written into the empty `folder`."""


@dataclass
class Tally:
    """How many inputs were tried, what became of them, and the first input of each kind of fault."""

    done: int = 0
    seconds: float = 0.0
    counts: Counter[str] = field(default_factory=Counter)
    faults: dict[str, int] = field(default_factory=dict)
    times: Counter[str] = field(default_factory=Counter)

    def add(self, number: int, verdict: str) -> None:
        """Count the verdict on input `number`."""
        self.done = number + 1
        kind = verdict.partition(":")[0].partition(" of ")[0]
        self.counts[kind] += 1
        if kind not in ("result", "refused"):
            self.faults.setdefault(verdict, number)
            self.times[verdict] += 1

    def as_json(self) -> dict[str, object]:
        """The tally for a file."""
        return {
            "done": self.done,
            "seconds": self.seconds,
            "counts": self.counts,
            "faults": self.faults,
            "times": self.times,
        }

    @classmethod
    def read(cls, path: Path) -> "Tally":
        """The tally in a file; an empty one where there is none."""
        if not path.is_file():
            return cls()
        content = json.loads(path.read_text())
        counts, times = Counter(content["counts"]), Counter(content["times"])
        return cls(content["done"], content["seconds"], counts, content["faults"], times)


def try_cases(
    cases: Cases, tally: Tally, total: int, until: float, save: Callable[[], None], *, batch: int = BATCH
) -> None:
    """Try inputs from `tally.done` on, up to number `total` or the time `until`, in batches of one fork each."""
    scratch = Path(tempfile.mkdtemp(dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
    try:
        while tally.done < total and time.monotonic() < until:
            started = time.monotonic()
            _try_batch(cases, tally, min(batch, total - tally.done), scratch, until)
            tally.seconds += time.monotonic() - started
            save()
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _try_batch(cases: Cases, tally: Tally, count: int, scratch: Path, until: float) -> None:
    """Try the next `count` inputs in one fork; what ends it is the verdict on the input that was being tried."""
    reading, writing = os.pipe()
    shared = mmap.mmap(-1, 8)  # the number of the input that is being tried
    first = tally.done
    child = os.fork()
    if child == 0:
        os.close(reading)
        _run_batch(cases, range(first, first + count), scratch, writing, shared, until)
    os.close(writing)
    with os.fdopen(reading) as lines:
        for line in lines:
            number, verdict = json.loads(line)
            tally.add(number, verdict)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        slow = {"SIGPROF": f"hang: {_hang(cases):g} s of computing", "SIGALRM": f"hang: {STUCK:g} s of waiting"}
        tally.add(struct.unpack("q", shared[:8])[0], slow.get(name, f"crash: {name}"))
    elif os.WEXITSTATUS(status):
        tally.add(struct.unpack("q", shared[:8])[0], f"crash: exit {os.WEXITSTATUS(status)}")


def _hang(cases: Cases) -> float:
    return float(getattr(cases, "hang", HANG))


def _run_batch(cases: Cases, numbers: range, scratch: Path, writing: int, shared: mmap.mmap, until: float) -> None:
    """Try the inputs and write a line on each; never returns. Signals of the timers end the process."""
    for timer in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(timer, signal.SIG_DFL)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ended = 3
    try:
        for number in numbers:
            folder = Path(tempfile.mkdtemp(dir=scratch))
            shared[:8] = struct.pack("q", number)
            signal.setitimer(signal.ITIMER_PROF, _hang(cases))
            signal.alarm(STUCK)
            verdict = cases.run(number, folder)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.alarm(0)
            shutil.rmtree(folder, ignore_errors=True)
            above = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            if above > MEMORY:
                verdict = f"memory: {above / 2**30:.1f} GiB"
            os.write(writing, (json.dumps([number, verdict]) + "\n").encode())
            if above > MEMORY or time.monotonic() > until:
                break
        ended = 0
    finally:
        os._exit(ended)
