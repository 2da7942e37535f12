"""Atomic writing of output files (temporary name, then rename), and output folders of commands."""

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drake_cafim.errors import InputError

TEMPORARY = ".cafim-"
"""Beginning of the names of files that are being written; a killed process leaves its own, see `alone_in`."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, renamed to `path` at the end of the block, removed if the block raises.

    The temporary name keeps the suffix, since writers choose their format by it. Raises `InputError` where the file
    cannot be written, as on a full disk or in a folder that is read-only or deleted; what was there stays.
    """
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # a fixed short name: with that of `path` the longest permitted one would become too long
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=TEMPORARY, suffix=path.suffix)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):  # the folder may be gone
                temporary.unlink(missing_ok=True)
            raise


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn the system's errors into an `InputError` that names the file that is written."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: it cannot be written ({describe_error(error)}); what was there is unchanged"
        ) from error


def write_text(path: Path, text: str) -> None:
    """Write `text` (UTF-8) to `path` atomically."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def prepare_folder(out: Path | None, command: str, *, resume: bool, overwrite: bool) -> Path:
    """The folder that a command writes to; by default the first free `cafim-out/<command>-<n>`.

    Raises `InputError` where `out` is a file, contains files and neither `resume` nor `overwrite` is set, or cannot be
    made.
    """
    with _making(out):
        if out is None:
            return _first_free(Path("cafim-out"), command)
        if out.exists() and not out.is_dir():
            raise InputError(f"--out {out}: there is a file of that name, expected a folder")
        if out.is_dir() and any(out.iterdir()) and not (resume or overwrite):
            raise InputError(f"--out {out}: the folder is not empty; give --resume or --overwrite, or another folder")
        out.mkdir(parents=True, exist_ok=True)
        return out


def _first_free(parent: Path, command: str) -> Path:
    """The first folder `<command>-<n>` that did not exist, made; two processes never get the same one."""
    parent.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(1):
        folder = parent / f"{command}-{number}"
        with suppress(FileExistsError):
            folder.mkdir()
            return folder
    raise AssertionError


@contextmanager
def _making(out: Path | None) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {out or 'cafim-out'}: the folder cannot be used ({describe_error(error)})") from None


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """No other process may enter this for the same folder until the block ends, or the process does, however it ends.

    What a killed process has left half-written is removed. Raises `InputError` where another process is in the folder.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"--out {folder}: another process is writing into this folder; wait for it, or give another folder"
            ) from None
        except OSError:  # a file system without locks
            yield
            return
        for left in folder.glob(f"{TEMPORARY}*"):
            with suppress(OSError):
                left.unlink()
        yield
    finally:
        os.close(handle)


def describe_error(error: OSError) -> str:
    """The system's reason in a few words, as `No space left on device`."""
    return os.strerror(error.errno) if error.errno else " ".join(str(error).split()) or type(error).__name__
