"""How commands end from outside: what they say, what they leave, and that none of their processes outlives them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drake_cafim.output import TEMPORARY, alone_in, replacing
from tests.parametrize import long_after

WORK = """
import os, sys, time
from pathlib import Path
folder = Path(sys.argv[-1])
def work(*arguments, **options):
    import os, time
    (folder / f"process_{os.getpid()}").touch()
    time.sleep(60)
"""
FORKED = f"""{WORK}
from drake_cafim.output import alone_in
from drake_cafim.parallel.forked import map_forked
with alone_in(folder):
    list(map_forked(work, 99, 2))
"""
TASKS = f"""{WORK}
from drake_cafim.parallel.processes import on_processes
from drake_cafim.parallel.task import Task
list(on_processes([Task(str(number), work, (number,)) for number in range(99)], 2))
"""
COMMAND = f"""{WORK}
from drake_cafim import cli
from drake_cafim.commands import diagnose
diagnose.diagnose_command = work
cli.run_cli()
"""
SOLVING = f"""{WORK}
import numpy as np
from pydrake.solvers import MathematicalProgram, SnoptSolver
from drake_cafim import cli
from drake_cafim.parallel.distribute import distribute
from drake_cafim.parallel.task import Task
def cost(values):
    work()
    return values[0] ** 2
def solve():
    program = MathematicalProgram()
    program.AddCost(cost, vars=program.NewContinuousVariables(1))
    SnoptSolver().Solve(program, np.ones(1))
def study(*arguments, **options):
    return list(distribute([Task("solve", solve, ()), Task("solve again", solve, ())], 1))
from drake_cafim.commands import diagnose
diagnose.diagnose_command = study
cli.run_cli()
"""
BEFORE = """
from drake_cafim import cli
def stop(*arguments, **options):
    raise KeyboardInterrupt
cli.main.make_context = stop
cli.run_cli()
"""


def _started(code: str, folder: Path, processes: int, *arguments: str) -> "subprocess.Popen[str]":
    """A Python process that carries out the code, once so many processes have begun to work.

    It answers to Ctrl-C, also where what runs these tests does not, as a shell's background jobs do not.
    """
    command, pipe = [sys.executable, "-c", code, *arguments, str(folder)], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, preexec_fn=_answer_to_ctrl_c)
    until = time.monotonic() + 120.0
    while len(_working(folder)) < processes:
        assert time.monotonic() < until and process.poll() is None, process.communicate()
        time.sleep(0.05)
    return process


def _answer_to_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _working(folder: Path) -> list[int]:
    return [int(path.name.rpartition("_")[2]) for path in folder.glob("process_*")]


def _all_end(processes: list[int]) -> bool:
    """Whether all of them end within some seconds, sooner than the work does."""
    until = time.monotonic() + 15.0
    while time.monotonic() < until:
        if not any(Path(f"/proc/{process}").exists() for process in processes):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="/proc says which processes there are")
@pytest.mark.parametrize("code", [FORKED, TASKS])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_the_one_that_made_it(code: str, number: int, tmp_path: Path) -> None:
    process = _started(code, tmp_path, 2)
    working = _working(tmp_path)
    process.send_signal(number)
    process.communicate(timeout=30)  # until no process holds its stdout
    try:
        assert _all_end(working)
        with alone_in(tmp_path):
            pass
    finally:
        for left in working:
            if Path(f"/proc/{left}").exists():
                os.kill(left, signal.SIGKILL)


@pytest.mark.parametrize("code", [COMMAND, SOLVING])
@pytest.mark.parametrize(("number", "status"), long_after(1, [(signal.SIGINT, 130), (signal.SIGTERM, 143)]))
def test_a_command_that_is_ended_says_how_to_go_on(number: int, status: int, code: str, tmp_path: Path) -> None:
    process = _started(code, tmp_path, 1, "diagnose", "x.yaml", "--recording", "a.csv", "--resume", "--out")
    process.send_signal(number)
    _, said = process.communicate(timeout=30)
    assert process.returncode == status
    assert said == (
        f"cafim: interrupted; what was finished is in {tmp_path}, the same command with --out {tmp_path} --resume goes "
        "on from there\n"
    )


def test_ctrl_c_before_the_command_begins_is_said() -> None:
    done = subprocess.run([sys.executable, "-c", BEFORE], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.strip()) == (130, "cafim: interrupted, before it began or after its end")


def test_what_was_left_half_is_removed_below_too_but_not_what_is_being_written(tmp_path: Path) -> None:
    below = tmp_path / "arm" / "2026-W01"
    below.mkdir(parents=True)
    (below / f"{TEMPORARY}left.json").write_text("half")
    with replacing(below / "whole.json") as temporary:
        with alone_in(tmp_path):
            assert list(below.iterdir()) == [temporary]
        temporary.write_text("{}")
    assert [path.name for path in below.iterdir()] == ["whole.json"]
