"""Ctrl-C and SIGTERM, also where C++ code turns what they raise into another exception."""

import os
import signal
from types import FrameType

INTERRUPTED, TERMINATED = 130, 143
"""Exit status after Ctrl-C and after SIGTERM, as shells have it."""
_come: list[KeyboardInterrupt] = []


class Terminated(KeyboardInterrupt):
    """SIGTERM, as from `kill`, a queue or a container that stops: it ends a command as Ctrl-C does."""


def watch_for_interruptions() -> None:
    """From now on SIGTERM raises `Terminated`, and Ctrl-C `KeyboardInterrupt`; copies of this process end at once."""
    own = os.getpid()

    def end(number: int, frame: FrameType | None) -> None:
        if os.getpid() != own:
            os._exit(128 + number)
        _come.append(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
        raise _come[-1]

    signal.signal(signal.SIGTERM, end)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored, as under nohup
        signal.signal(signal.SIGINT, end)


def pass_on_interruption() -> None:
    """Raise what has come and was turned into another exception, as Drake's solvers do with all that a cost raises."""
    if _come:
        raise _come[-1]


def status_of(interruption: BaseException) -> int:
    """The exit status after Ctrl-C or SIGTERM."""
    return TERMINATED if isinstance(interruption, Terminated) else INTERRUPTED
