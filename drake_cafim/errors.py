"""The exception for unusable input."""

import re

LONGEST = 480
"""Largest number of characters of a message; with the command's name before it, it stays under 500."""
_ENDS = 150  # characters that are kept of the beginning and of the end of a word that is too long
_UNPRINTABLE = re.compile(r"[\x00-\x20\x7f-\x9f\u2028\u2029\ud800-\udfff]+")


class InputError(Exception):
    """Unusable input: a file, a column, a key or an option.

    The message is one sentence that names the file, the column or key, what was found and what was
    expected (with the valid choices where there are some). It is one line of at most `LONGEST` characters, whatever
    the input holds: line breaks and control characters become spaces, and the middle of what is too long is left out.
    The command line prints it alone and exits with status 2; any other exception that reaches the command line is a
    defect of the package.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


class OutputError(InputError):
    """A file or a folder that cannot be written, as on a full disk."""


def one_line(text: str) -> str:
    """The text in one line of at most `LONGEST` characters: first without the middle of long words, as of paths."""
    plain = _UNPRINTABLE.sub(" ", text).strip(" ")
    if len(plain) <= LONGEST:
        return plain
    shorter = " ".join(_shorten(word, 2 * _ENDS) for word in plain.split(" "))
    return _shorten(shorter, LONGEST)


def _shorten(text: str, length: int) -> str:
    """The text with its middle replaced by dots where it is longer than `length`."""
    if len(text) <= length:
        return text
    end = (length - 5) // 2
    return f"{text[:end].rstrip(' ')} ... {text[-end:].lstrip(' ')}"


def check_type(argument: str, value: object, kinds: type | tuple[type, ...], expected: str) -> None:
    """Raises `InputError` where the `argument` that a script gave is of none of the `kinds`."""
    if not isinstance(value, kinds):
        raise InputError(f"{argument} is of the type {type(value).__name__}, expected {expected}")
