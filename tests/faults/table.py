"""`make faults`: commands are killed, starved of disk, and robbed of their folders; a row a fault.

    make faults                                     # 200 kills; FAULTS="--kills 20 --only import diagnose" for fewer

Every row counts faults that were tried, files that were left half, results that were lost or differ once the command
was given again, and tracebacks.
"""

import argparse
import contextlib
import itertools
import os
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from tests.faults.commands import (
    DIAGNOSE,
    FLEET,
    IMPORT,
    PARTS,
    RUN,
    STUDY,
    Subject,
    contents,
    finish,
    half_files,
    kill_after,
    leftovers,
    prepare,
    said,
    start,
)

SUBJECTS = {subject.name: subject for subject in (IMPORT, DIAGNOSE, PARTS, FLEET, STUDY, RUN)}


@dataclass
class Row:
    """What was tried on one command, and what went wrong."""

    command: str
    fault: str
    tried: int = 0
    half: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    tracebacks: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        wrong = [*self.half, *self.lost, *self.tracebacks][:3]
        counts = f"{self.tried} | {len(self.half)} | {len(self.lost)} | {len(self.tracebacks)}"
        return f"| {self.command} | {self.fault} | {counts} | {'; '.join(wrong)} |"


@dataclass(frozen=True)
class Bench:
    """A folder with a command's files, what an undisturbed run of it leaves, and how long that takes."""

    subject: Subject
    folder: Path
    whole: dict[str, str]
    seconds: float

    @classmethod
    def of(cls, subject: Subject, folder: Path) -> "Bench":
        """The bench of a command, which is carried out once to compile, and once for its time."""
        folder.mkdir(parents=True, exist_ok=True)
        prepare(folder)
        for name in ("warm", "whole"):
            began = time.monotonic()
            status = finish(start(subject, folder, folder / name))
            if status:
                raise RuntimeError(f"{subject.name} ended with {status}: {said(folder / name)}")
        return cls(subject, folder, contents(folder / "whole"), time.monotonic() - began)

    def judge(self, row: Row, out: Path, status: int, allowed: tuple[int, ...]) -> None:
        """Count one trial: half files at once; what is lost, once the command was given again."""
        row.tried += 1
        row.half += [f"{out.name}: {name}" for name in half_files(out)]
        words = said(out)
        if status not in allowed or any("Traceback" in word for word in words) or (status == 2 and len(words) != 1):
            row.tracebacks.append(f"{out.name}: status {status}, {' '.join(words)[-120:]}")

    def finish(self, row: Row, out: Path) -> None:
        """Give the command again, and compare with the undisturbed run."""
        status = finish(start(self.subject, self.folder, out, *self.subject.again))
        if status or contents(out) != self.whole or leftovers(out):
            differing = sorted(set(contents(out).items()) ^ set(self.whole.items()))
            row.lost.append(f"{out.name}: status {status}, {differing[:2]}, {leftovers(out)}, {said(out)[-1:]}")


def kills(bench: Bench, count: int, rng: np.random.Generator) -> Row:
    """`kill -9` at random moments; each folder is finished by the same command again."""
    row = Row(bench.subject.name, "kill -9")
    for k in range(count):
        out = bench.folder / f"killed_{k}"
        status = kill_after(start(bench.subject, bench.folder, out), rng.uniform(0, bench.seconds), signal.SIGKILL)
        bench.judge(row, out, status, (0, -signal.SIGKILL))
        bench.finish(row, out)
        shutil.rmtree(out, ignore_errors=True)
    return row


def interrupts(bench: Bench, count: int, rng: np.random.Generator) -> Row:
    """Ctrl-C at random moments: one line that says what is kept, and the command again goes on."""
    row = Row(bench.subject.name, "Ctrl-C")
    for k in range(count):
        out = bench.folder / f"interrupted_{k}"
        status = kill_after(start(bench.subject, bench.folder, out), rng.uniform(0, bench.seconds), signal.SIGINT)
        bench.judge(row, out, status, (0, 1, 130))
        if status == 130 and not any("interrupted" in line for line in said(out)):
            row.tracebacks.append(f"{out.name}: it said {said(out)}")
        bench.finish(row, out)
    return row


def full_disks(bench: Bench) -> Row:
    """A disk with room for ever more of the results: status 2 and one line, until there is enough."""
    row = Row(bench.subject.name, "disk full")
    size = sum(path.stat().st_size for path in (bench.folder / "whole").rglob("*") if path.is_file())
    for k, room in enumerate((4096, *np.linspace(8192, 0.95 * size, 6).astype(int).tolist())):
        out = bench.folder / f"full_{k}"
        with _small_disk(out, room) as limit:
            status = finish(start(bench.subject, bench.folder, out, "--overwrite", first=limit))
            bench.judge(row, out, status, (0, 2))
            row.tracebacks += [f"{out.name}: {name} left" for name in leftovers(out)]
    return row


@contextlib.contextmanager
def _small_disk(out: Path, room: int) -> Iterator[Callable[[], None]]:
    """`out` on a disk of `room` bytes; without the right to mount one, files of at most so many bytes."""
    out.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={room}", "none", str(out)], capture_output=True, check=False
    )

    def limit() -> None:
        if mounted.returncode:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room // 4, room // 4))

    try:
        yield limit
    finally:
        if not mounted.returncode:
            subprocess.run(["umount", "-l", str(out)], check=False)


def jumping_clock(bench: Bench) -> Row:
    """Clocks that jump by an hour, forwards and back, at every reading: the same results."""
    row = Row(bench.subject.name, "clock jumps")

    def jump() -> None:
        readings = itertools.cycle((0.0, 3600.0, -3600.0, 1e6))
        real = time.time
        patch("time.time", lambda: real() + next(readings)).start()
        patch("time.perf_counter", lambda: real() + next(readings)).start()

    out = bench.folder / "jumping"
    bench.judge(row, out, finish(start(bench.subject, bench.folder, out, first=jump)), (0,))
    if contents(out) != bench.whole:
        row.lost.append("other results")
    return row


def two_on_one_folder(bench: Bench, count: int) -> Row:
    """Two processes on one `--out`: one of them carries it out, the other says that it is taken."""
    row = Row(bench.subject.name, "two on one --out")
    for k in range(count):
        out = bench.folder / f"shared_{k}"
        children = [start(bench.subject, bench.folder, out, "--overwrite") for _ in range(2)]
        statuses = sorted(finish(child) for child in children)
        row.tried += 1
        if statuses not in ([0, 2], [0, 0]):  # [0, 0]: one after the other
            row.tracebacks.append(f"{out.name}: {statuses} {said(out)}")
        row.half += half_files(out)
        if contents(out) != bench.whole:
            row.lost.append(f"{out.name}: other results")
    return row


def lost_folders(bench: Bench) -> Row:
    """Folders that cannot be made, are read-only, or are deleted while the command runs."""
    row = Row(bench.subject.name, "no folder")
    out = bench.folder / "deleted"
    child = start(bench.subject, bench.folder, out)
    for _ in range(200):
        shutil.rmtree(out, ignore_errors=True)
        time.sleep(bench.seconds / 150)
    bench.judge(row, out, finish(child), (0, 2))
    file = bench.folder / "file"
    file.write_text("x")
    for place in (Path("/proc/nowhere"), file / "below", bench.folder / ("long" * 100)):
        log = bench.folder / f"log_{row.tried}"
        subject = replace(bench.subject, arguments=(*bench.subject.arguments, "--out", str(place)), again=())
        status = finish(start(subject, bench.folder, log, "--out", str(place)))
        bench.judge(row, log, status, (2,))
    gone = bench.folder / "gone"
    gone.mkdir()
    log = bench.folder / "log_gone"
    status = finish(start(bench.subject, gone, log, first=gone.rmdir))
    bench.judge(row, log, status, (2,))
    return row


def main() -> None:
    """Try the faults, and print the table; the exit status is 1 where something went wrong."""
    parser = argparse.ArgumentParser(description="Faults while commands run, and a table of what became of them.")
    parser.add_argument("--kills", type=int, default=200, help="kills, over all commands")
    parser.add_argument("--only", nargs="+", choices=list(SUBJECTS), default=list(SUBJECTS), help="which commands")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    rng = np.random.default_rng(arguments.seed)
    failed = False
    print("| command | fault | tried | half files | lost, or different | tracebacks and other words | first of them |")
    print("|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as name:
        for subject in (SUBJECTS[name] for name in arguments.only):
            bench = Bench.of(subject, Path(name) / subject.name)
            share = max(1, arguments.kills // len(arguments.only))
            tests: list[Callable[[], Row]] = [
                lambda bench=bench, share=share: kills(bench, share, rng),  # type: ignore[misc]
                lambda bench=bench, share=share: interrupts(bench, max(1, share // 4), rng),  # type: ignore[misc]
                lambda bench=bench: full_disks(bench),  # type: ignore[misc]
                lambda bench=bench: jumping_clock(bench),  # type: ignore[misc]
                lambda bench=bench: two_on_one_folder(bench, 2),  # type: ignore[misc]
                lambda bench=bench: lost_folders(bench),  # type: ignore[misc]
            ]
            for test in tests:
                row = test()
                failed = failed or bool(row.half or row.lost or row.tracebacks)
                print(row, flush=True)
    raise SystemExit(failed)


if __name__ == "__main__":
    main()
