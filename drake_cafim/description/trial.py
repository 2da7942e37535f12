"""Trial of an action in a child process, where one that ends the process, or never ends, does no harm."""

import os
import select
import signal
import sys
import threading
import warnings
from collections.abc import Callable

from drake_cafim.errors import InputError

COMPUTING = 10.0
"""s, longest time that a trial computes; the largest public robot description takes about one."""
PATIENCE = 600.0
"""s, longest time that is waited for a trial: a busy machine may hold it up a hundredfold."""


def try_apart(action: Callable[[], object], source: str) -> None:
    """Call `action` in a forked child; whatever it raises there is left to the caller's own call of it.

    C++ code that recurses without an end, or fails in a destructor, ends its process, which no `except` can prevent.
    Raises `InputError`, which names `source`, where the child was ended by a signal, or takes too long.
    On systems where a process with threads cannot be forked nothing is tried.
    """
    if sys.platform != "linux":
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 on forks of processes with threads
        sys.stdout.flush()
        sys.stderr.flush()
        child = os.fork()
    if child == 0:
        _run_quietly(action)
    finished = False
    try:
        finished = _is_finished(child)
        if not finished:
            raise InputError(_too_long(source, PATIENCE))
    finally:
        if not finished:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        if os.WTERMSIG(status) == signal.SIGPROF:
            raise InputError(_too_long(source, COMPUTING))
        name = signal.Signals(os.WTERMSIG(status)).name
        raise InputError(
            f"{source}: Drake's parser ends the process ({name}) on it, as where definitions refer to each other in a "
            "circle or nest too deeply; expected a model that it can read"
        )


def _too_long(source: str, seconds: float) -> str:
    return f"{source}: Drake's parser takes longer than {seconds:g} s with it, expected a model of a robot"


def _run_quietly(action: Callable[[], object]) -> None:
    """Call `action` and end this process without any of Python's clean-up, which belongs to the parent."""
    try:
        # a terminal's Ctrl-C is the parent's to answer
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, COMPUTING)
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # a lock that the parent has would outlive it here
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        action()
    except BaseException:  # the caller sees it when it calls the action itself
        pass
    finally:
        os._exit(0)


def _is_finished(child: int) -> bool:
    """Whether the child has ended within `PATIENCE` seconds."""
    descriptor = os.pidfd_open(child)
    try:
        ready, _, _ = select.select([descriptor], [], [], PATIENCE)
        return bool(ready)
    finally:
        os.close(descriptor)
