"""Runs `cafim` commands in forks of a process that has only imported its modules.

Importing them takes seconds, which a proof of a thousand diagnoses would otherwise spend on each.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path


@cache
def _server() -> subprocess.Popen[str]:
    """This process's own; it ends with it."""
    environment = {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.concealed.fork_server"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
        env=environment | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"},
    )
    atexit.register(process.kill)
    return process


def run_cafim(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], errors: Path, limit: float
) -> int | None:
    """The exit code of `cafim arguments` in `folder`, None after `limit` s; stderr goes to `errors`."""
    server = _server()
    assert server.stdin is not None and server.stdout is not None
    request = [list(arguments), str(folder), dict(environment), str(errors), limit]
    server.stdin.write(json.dumps(request) + "\n")
    server.stdin.flush()
    answer = server.stdout.readline()
    if not answer:
        raise RuntimeError("the process that runs `cafim` has ended")
    code = json.loads(answer)
    return None if code == -signal.SIGALRM else int(code)


def _serve() -> None:
    import drake_cafim.commands.diagnose  # noqa: F401  read before the forks
    from drake_cafim.cli import run_cli

    for line in sys.stdin:
        arguments, folder, environment, errors, limit = json.loads(line)
        child = os.fork()
        if child == 0:
            signal.setitimer(signal.ITIMER_REAL, limit)
            nothing = os.open(os.devnull, os.O_RDWR)
            told = os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream, file in ((0, nothing), (1, nothing), (2, told)):
                os.dup2(file, stream)
            os.chdir(folder)
            os.environ.clear()
            os.environ.update(environment)
            time.tzset()
            sys.argv = ["cafim", *arguments]
            run_cli()
            sys.exit(0)
        print(json.dumps(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])), flush=True)


if __name__ == "__main__":
    _serve()
