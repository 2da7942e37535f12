"""What Drake's parser has to say, kept from the terminal."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class _Kept(logging.Handler):
    def __init__(self, lines: list[str]) -> None:
        super().__init__()
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append(" ".join(record.getMessage().split()))


@contextmanager
def kept_log() -> Iterator[list[str]]:
    """The warnings of Drake's log meanwhile, one line each, instead of on stderr."""
    lines: list[str] = []
    log, handler = logging.getLogger("drake"), _Kept(lines)
    handlers, propagates = log.handlers[:], log.propagate
    log.handlers, log.propagate = [handler], False
    try:
        yield lines
    finally:
        log.handlers, log.propagate = handlers, propagates
