"""One fault each: a command is disturbed, what it leaves is judged, and it is given again."""

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from tests.faults.commands import (
    Subject,
    contents,
    finish,
    half_files,
    kill_after,
    leftovers,
    prepare,
    said,
    start,
    writings,
)

PAGE = 4096
"""bytes of a block of a small disk."""
FAKETIME = "/usr/lib/*/faketime/libfaketime.so.1"
JUMPS = (0, 3600, -3600, 86400, -86400 * 400, 10**7)
"""s, by which a jumping clock is off."""


@dataclass
class Trial:
    """How many faults were tried on one command, and what went wrong."""

    faults: int = 0
    half: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Bench:
    """A folder with a command's files, what an undisturbed run of it leaves, how long that takes, and the size of each
    file that it writes, in order.
    """

    subject: Subject
    folder: Path
    whole: dict[str, str]
    seconds: float
    sizes: tuple[int, ...]

    @classmethod
    def of(cls, subject: Subject, folder: Path) -> "Bench":
        """The bench of a command, which is carried out once to compile, once for its time, and once for its writes."""
        folder.mkdir(parents=True, exist_ok=True)
        prepare(folder)
        log = folder / "sizes"
        log.touch()
        seconds = 0.0
        for name, first in (("warm", _nothing), ("whole", _nothing), ("logged", lambda: _log_sizes(log))):
            began = time.monotonic()
            status = finish(start(subject, folder, folder / name, first=first))
            seconds = seconds if name == "logged" else time.monotonic() - began
            if status:
                raise RuntimeError(f"{subject.name} ended with {status}: {said(folder / name)}")
        whole = contents(folder / "whole")
        for name in ("warm", "logged"):
            if contents(folder / name) != whole or leftovers(folder / name):
                raise RuntimeError(f"{subject.name}: two undisturbed runs differ: {_differing(folder / name, whole)}")
        return cls(subject, folder, whole, seconds, tuple(int(line) for line in log.read_text().splitlines()))

    def judge(self, trial: Trial, out: Path, status: int, allowed: Sequence[int]) -> None:
        """Count one fault, what it left half, and other statuses and words than are allowed."""
        trial.faults += 1
        trial.half += [f"{out.name}: {name}" for name in half_files(out)]
        words = said(out)
        wordy = len(words) != (0 if status in (0, -signal.SIGKILL) else 1)
        if status not in allowed or any("Traceback" in word for word in words) or (wordy and status != -signal.SIGTERM):
            trial.words.append(f"{out.name}: status {status}, {' '.join(words)[-160:]}")

    def finish(self, trial: Trial, out: Path, again: Sequence[str] | None = None) -> None:
        """Give the command again, compare with the undisturbed run, and remove it."""
        before = writings(self.subject, out)
        status = finish(start(self.subject, self.folder, out, *(self.subject.again if again is None else again)))
        if status or contents(out) != self.whole:
            trial.lost.append(f"{out.name}: status {status}, {_differing(out, self.whole)}, {said(out)[-1:]}")
        now = writings(self.subject, out)
        if again is None or "--overwrite" not in again:
            trial.lost += [f"{path.relative_to(out)}: twice" for path in before if now.get(path) != before[path]]
        shutil.rmtree(out, ignore_errors=True)


def _nothing() -> None:
    pass


def _differing(out: Path, whole: dict[str, str]) -> list[str]:
    return sorted({name for name, _ in set(contents(out).items()) ^ set(whole.items())})[:3]


def kill(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """`kill -9` at a random moment; one time in three, what goes on from there is killed once more."""
    trial, out = Trial(), bench.folder / f"killed_{number}"
    status = 0
    while status == 0:  # it was done before the moment came
        shutil.rmtree(out, ignore_errors=True)
        status = kill_after(start(bench.subject, bench.folder, out), rng.uniform(0, bench.seconds), signal.SIGKILL)
    bench.judge(trial, out, status, [-signal.SIGKILL])
    if number % 3 == 2:
        again = start(bench.subject, bench.folder, out, *bench.subject.again)
        status = kill_after(again, rng.uniform(0, bench.seconds), signal.SIGKILL)
        if status:
            bench.judge(trial, out, status, [-signal.SIGKILL])
    bench.finish(trial, out)
    return trial


def kill_at_write(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """`kill -9` when file `number` is written: before it is there, or just after."""
    trial, out, after = Trial(), bench.folder / f"killed_at_write_{number}", bool(rng.integers(2))
    status = finish(start(bench.subject, bench.folder, out, first=lambda: _die_at(number, after)))
    bench.judge(trial, out, status, [-signal.SIGKILL])
    bench.finish(trial, out)
    return trial


def interrupt(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """Ctrl-C or SIGTERM at a random moment: one line that says what is kept, and how to go on, which is done."""
    trial, out = Trial(), bench.folder / f"interrupted_{number}"
    sent, expected = ((signal.SIGINT, 130), (signal.SIGTERM, 143))[number % 2]
    status = 0
    while status == 0:
        shutil.rmtree(out, ignore_errors=True)
        status = kill_after(start(bench.subject, bench.folder, out), rng.uniform(0, bench.seconds), sent)
    words = said(out)
    if out.exists() or words:
        bench.judge(trial, out, status, [expected])
    else:
        trial.faults += 1  # it had not begun
    if any("after its end" in line for line in words):
        bench.finish(trial, out)
        return trial
    again = [word for word in ("--resume", "--overwrite") if any(word in line for line in words)]
    if bool(again) != out.exists():
        trial.words.append(f"{out.name}: {words}, and there are {sorted(contents(out))}")
    bench.finish(trial, out, again)
    return trial


def fill_disk(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """A disk that is full within file `number`: one line and status 2; with more room the command goes on."""
    trial, out = Trial(), bench.folder / f"full_{number}"
    blocks = [-(-size // PAGE) for size in bench.sizes]
    room = max(1, sum(blocks[:number]) + blocks[number] // 2)  # the smallest disk has one block
    with _small_disk(out, room * PAGE) as (limit, enlarge):
        status = finish(start(bench.subject, bench.folder, out, "--overwrite", first=limit))
        bench.judge(trial, out, status, [0, 2])
        trial.words += [f"{out.name}: {name} left" for name in leftovers(out)]
        trial.faults -= status == 0  # what was overwritten has left enough room
        enlarge()
        bench.finish(trial, out)
    shutil.rmtree(out, ignore_errors=True)
    return trial


@contextlib.contextmanager
def _small_disk(out: Path, room: int) -> Iterator[tuple[Callable[[], None], Callable[[], None]]]:
    """`out` on a disk of `room` bytes; without the right to mount one, files of at most so many bytes."""
    out.mkdir()

    def mount(size: int, *more: str) -> bool:
        options = ",".join([*more, f"size={size}"])
        command = ["mount", "-t", "tmpfs", "-o", options, "none", str(out)]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    mounted = mount(room)

    def limit() -> None:
        if not mounted:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room // 4, room // 4))

    def enlarge() -> None:
        if mounted and not mount(2**30, "remount"):
            raise RuntimeError(f"{out} cannot be enlarged")

    try:
        yield limit, enlarge
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(out)], check=False)


def jump_clock(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """A clock that jumps by up to a year every 50 ms, by libfaketime; without it, at every reading of Python's."""
    trial, out = Trial(), bench.folder / f"jumping_{number}"
    libraries = sorted(Path("/").glob(FAKETIME.removeprefix("/")))
    if not libraries:
        status = finish(start(bench.subject, bench.folder, out, first=lambda: _jump_at_readings(rng)))
    else:
        off, code = bench.folder / "clock", "import sys; from tests.faults import commands; commands.call(sys.argv)"
        off.write_text("+0")
        clock = {"LD_PRELOAD": str(libraries[0]), "FAKETIME_TIMESTAMP_FILE": str(off), "FAKETIME_NO_CACHE": "1"}
        clock |= {"FAKETIME_DONT_FAKE_MONOTONIC": "1", "NO_FAKE_STAT": "1"}
        with open(f"{out}.err", "w") as errors:
            process = subprocess.Popen(
                [sys.executable, "-c", code, bench.subject.name, str(bench.folder), str(out)],
                stdout=subprocess.DEVNULL,
                stderr=errors,
                env={**os.environ, **clock},
            )
            while process.poll() is None:
                (bench.folder / "clock.new").write_text(f"{rng.choice(JUMPS):+d}")
                os.replace(bench.folder / "clock.new", off)
                time.sleep(0.05)
        status = process.returncode
    bench.judge(trial, out, status, [0])
    if contents(out) != bench.whole:
        trial.lost.append(f"{out.name}: {_differing(out, bench.whole)}")
    return trial


def two_on_one_folder(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """Two processes on one `--out`: one of them carries it out, the other says that it is taken."""
    trial, out = Trial(faults=1), bench.folder / f"shared_{number}"
    early = start(bench.subject, bench.folder, out, "--overwrite")
    if number % 2:
        time.sleep(rng.uniform(0, 0.8 * bench.seconds))
    late = _start_beside(bench, out, "--overwrite" if number % 4 < 2 else bench.subject.again[0])
    statuses = sorted([finish(early), finish(late)])
    if statuses == [0, 2]:
        lines = [*said(out), *said(out.parent / "beside")]
        if len(lines) != 1 or "another process is writing into this folder" not in lines[0]:
            trial.words.append(f"{out.name}: {lines}")
    elif statuses != [0, 0]:  # [0, 0]: one after the other
        trial.words.append(f"{out.name}: {statuses} {said(out)} {said(out.parent / 'beside')}")
    trial.half += half_files(out)
    if contents(out) != bench.whole or leftovers(out):
        trial.lost.append(f"{out.name}: {_differing(out, bench.whole)}")
    return trial


def _start_beside(bench: Bench, out: Path, option: str) -> int:
    """The command on `out`, whose words go to files of another name."""
    subject = replace(bench.subject, arguments=(*bench.subject.arguments, option))
    return start(subject, bench.folder, out.parent / "beside", "--out", str(out))


def lose_folder(bench: Bench, number: int, rng: np.random.Generator) -> Trial:
    """Folders that are deleted while the command runs, cannot be made, or are gone before."""
    trial, log = Trial(), bench.folder / f"lost_{number}"
    if number == 0:
        child, until = start(bench.subject, bench.folder, log), time.monotonic() + 1.2 * bench.seconds
        while time.monotonic() < until:
            shutil.rmtree(log, ignore_errors=True)
            time.sleep(bench.seconds / 150)
        bench.judge(trial, log, finish(child), [0, 2])
    elif number == 1:
        gone = bench.folder / "gone"
        gone.mkdir()
        status = finish(start(bench.subject, gone, log, first=gone.rmdir))
        bench.judge(trial, log, status, [0, 2])
        if status == 0 and contents(log) != bench.whole:  # it needs no file from there
            trial.lost.append(f"{log.name}: {_differing(log, bench.whole)}")
    else:
        file = bench.folder / "file"
        file.write_text("x")
        place = (Path("/proc/nowhere"), file / "below", bench.folder / ("long" * 100))[number - 2]
        bench.judge(trial, log, finish(start(bench.subject, bench.folder, log, "--out", str(place))), [2])
    return trial


def _at_replacing(what: Callable[[int, Path], None], after: Callable[[int], None] = lambda number: None) -> None:
    """Call `what` with the number and the whole file before each renaming, and `after` after it."""
    real, lock, count = os.replace, threading.Lock(), iter(range(10**6))

    def replacing(source: Path, target: Path) -> None:
        with lock:
            number = next(count)
        what(number, source)
        real(source, target)
        after(number)

    patch("os.replace", replacing).start()


def _log_sizes(log: Path) -> None:
    def note(number: int, file: Path) -> None:
        with log.open("a") as sizes:
            sizes.write(f"{file.stat().st_size}\n")

    _at_replacing(note)


def _die_at(number: int, after: bool) -> None:
    def die(now: int) -> None:
        if now == number:
            os.kill(os.getpid(), signal.SIGKILL)

    _at_replacing((lambda now, file: None) if after else (lambda now, file: die(now)), die)


def _jump_at_readings(rng: np.random.Generator) -> None:
    real = time.time
    patch("time.time", lambda: real() + float(rng.choice(JUMPS))).start()
