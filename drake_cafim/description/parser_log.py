"""Capture of the log of Drake's parser, so that its warnings become notes instead of text on the terminal."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class _LogCollector(logging.Handler):
    """A log handler that appends each message as one line to a list."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__()
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append(" ".join(record.getMessage().split()))


@contextmanager
def capture_log() -> Iterator[list[str]]:
    """Collect the messages of Drake's log within the block, one line each, instead of writing them to stderr."""
    lines: list[str] = []
    log, handler = logging.getLogger("drake"), _LogCollector(lines)
    handlers, propagates = log.handlers[:], log.propagate
    log.handlers, log.propagate = [handler], False
    try:
        yield lines
    finally:
        log.handlers, log.propagate = handlers, propagates
