"""Commands in forked processes that can be killed, and what is asked of the folders that they leave."""

import contextlib
import hashlib
import json
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy
import pyarrow.parquet
import yaml

from drake_cafim import recordings
from drake_cafim.cli import run_cli
from drake_cafim.commands import diagnose as _diagnose
from drake_cafim.commands import importing as _importing
from drake_cafim.commands import run as _run
from drake_cafim.commands import study as _study
from drake_cafim.output import TEMPORARY
from drake_cafim.scene.address import DIAGRAMS
from drake_cafim.studies import cell
from tests.test_cli import PENDULUM, SCENARIO, pendulum_recording

IMPORTED = (_diagnose, _importing, _run, _study)
"""Imported before any fork, so that none imports them again."""


@dataclass(frozen=True)
class Subject:
    """A command to disturb: its arguments without `--out`, those that finish what was interrupted, what is done before
    it in its process, and what of its files it never writes twice (a pattern).
    """

    name: str
    arguments: tuple[str, ...]
    again: tuple[str, ...]
    before: Callable[[], object] = lambda: None
    once: str = ""


def _hold_little() -> None:
    """Let a sample take so much memory that only one of these files fits into it."""
    patch("drake_cafim.diagnosis.long.budget.BYTES_BY_COLUMN", 3e5).start()


def _hold_the_watch() -> None:
    """Let plans take no time, so that all bytes of two runs can be compared."""
    patch("drake_cafim.design.system.perf_counter", lambda: 0.0).start()


def _shorten_runs() -> None:
    """Let the experiments of a study's runs be a quarter of a second."""
    carry_out = cell.run
    _hold_the_watch()
    patch(
        "drake_cafim.studies.cell.run",
        lambda task, options, world: carry_out(replace(task, periods=5), options, world),
    ).start()


IMPORT = Subject("import", ("import", "a.csv", "b.csv", "c.csv"), ("--overwrite",))
DIAGNOSE = Subject("diagnose", ("diagnose", "scenario.yaml", "--recording", "a.parquet", "--no-replay"), ("--resume",))
PARTS = Subject(
    "diagnose in parts",
    (*DIAGNOSE.arguments[:4], "b.parquet", "c.parquet", "--no-replay", "--memory", "0.25", "--jobs", "1"),
    ("--resume",),
    _hold_little,
)
FLEET = Subject("fleet", ("diagnose", "--fleet", "fleet", "--jobs", "1"), ("--resume",), once="arm_*/*/diagnosis.json")
STUDY = Subject(
    "study",
    ("study", "criteria", "--short", "--seeds", "1", "--jobs", "1"),
    ("--resume",),
    _shorten_runs,
    once="runs/*.json",
)
RUN = Subject("run", ("run", "run.yaml", "--experiments", "2", "--world", "model"), ("--resume",), _hold_the_watch)
SUBJECTS = {subject.name: subject for subject in (IMPORT, DIAGNOSE, PARTS, FLEET, STUDY, RUN)}


def prepare(folder: Path) -> None:
    """Write the files that the commands name."""
    (folder / "pendulum.urdf").write_text(PENDULUM)
    (folder / "scenario.yaml").write_text(SCENARIO)
    hefting = yaml.safe_load((DIAGRAMS / "hefting.yaml").read_text())
    hefting["task"]["periods"] = 10
    (folder / "run.yaml").write_text(yaml.safe_dump(hefting))
    for name, seed in (("a", 1), ("b", 2), ("c", 3)):
        recording = pendulum_recording(name, damping=0.15, seed=seed)
        recordings.write(recording, folder / f"{name}.parquet")
        recordings.write(recording, folder / f"{name}.csv")
        recordings.write(recording, folder / "fleet" / f"arm_{name}" / f"2026-W{seed:02d}" / "log.parquet")
    shutil.copy(folder / "pendulum.urdf", folder / "fleet")
    shutil.copy(folder / "scenario.yaml", folder / "fleet")


def start(subject: Subject, folder: Path, out: Path, *more: str, first: Callable[[], object] = lambda: None) -> int:
    """The process of the command, forked; `first` is called in it before, stdout and stderr go to files beside out."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child:
        return child
    status = 70
    try:
        os.setpgrp()
        os.chdir(folder)
        arguments = ["cafim", *subject.arguments, "--out", str(out), *more]
        with (
            open(f"{out.parent / out.name}.out", "w") as said,
            open(f"{out.parent / out.name}.err", "w") as errors,
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(errors),
            patch.object(sys, "argv", arguments),
        ):
            signal.signal(signal.SIGINT, signal.default_int_handler)
            status = 1
            try:
                subject.before()
                first()
                run_cli()
            except SystemExit as end:
                status = end.code if isinstance(end.code, int) else 0
            except KeyboardInterrupt:
                status = 130  # before the command has begun, or after its end
            except BaseException:
                traceback.print_exc(file=errors)
    finally:
        os._exit(status)


def call(words: list[str]) -> None:
    """Carry out a subject's command in this process: of `words` the last are its name, its folder and `--out`."""
    name, folder, out = words[-3:]
    os.chdir(folder)
    sys.argv = ["cafim", *SUBJECTS[name].arguments, "--out", out]
    SUBJECTS[name].before()
    run_cli()


def finish(child: int) -> int:
    """The exit status of the process; minus the signal that ended it."""
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


def kill_after(child: int, seconds: float, number: int) -> int:
    """Send the signal `number` to the process and its own after some seconds; its exit status."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.001)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, number) if number == signal.SIGKILL else os.kill(child, number)
    return finish(child)


def said(out: Path) -> list[str]:
    """The lines of stderr that are neither progress nor the empty one that ends a ^C."""
    lines = Path(f"{out}.err").read_text(errors="replace").splitlines()
    return [
        line for line in lines if line and not line.endswith((" ...", "; reading on"))
    ]  # click ends the line of a ^C


def half_files(out: Path) -> list[str]:
    """The files in the folder that are not whole; hidden temporary files do not count."""
    found = []
    for path in sorted(out.rglob("*")) if out.is_dir() else []:
        if path.is_dir() or path.name.startswith(TEMPORARY):
            continue
        kept = (".json", ".yaml", ".parquet", ".npz", ".html", ".svg")
        if path.suffix not in kept:
            found.append(f"{path.name}: no file of these commands")
        try:
            if path.suffix == ".json":
                json.loads(path.read_text())
            elif path.suffix == ".yaml":
                yaml.safe_load(path.read_text())
            elif path.suffix == ".parquet":
                pyarrow.parquet.read_table(path)
            elif path.suffix == ".npz":
                with numpy.load(path, allow_pickle=False) as arrays:
                    dict(arrays)
            elif path.suffix in (".html", ".svg") and not path.read_text().rstrip().endswith(f"</{path.suffix[1:]}>"):
                found.append(path.name)
        except Exception:
            found.append(path.name)
    return found


def contents(out: Path) -> dict[str, str]:
    """A digest of each file, by its path."""
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        for path in sorted(out.rglob("*"))
        if path.is_file()
    }


def writings(subject: Subject, out: Path) -> dict[Path, int]:
    """When each file that the command never writes twice was written."""
    found = out.glob(subject.once) if subject.once else ()
    return {path: path.stat().st_mtime_ns for path in found if not path.name.startswith(TEMPORARY)}


def leftovers(out: Path) -> list[str]:
    """Temporary files in the folder."""
    return [path.name for path in out.rglob(f"{TEMPORARY}*")]
