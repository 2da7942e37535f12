"""Atomic writing of output files (temporary name, then rename), and output folders of commands."""

import fcntl
import itertools
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drake_cafim.errors import InputError, OutputError

TEMPORARY = ".cafim-"
"""Beginning of the names of files that are being written; a killed process leaves its own, see `alone_in`."""
ENDING = 1.0
"""s that a process waits for a folder which another one has: the copies of one that was killed end shortly after it."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, renamed to `path` at the end of the block, removed if the block raises.

    The temporary name keeps the suffix, since writers choose their format by it. Raises `OutputError` where the file
    cannot be written, as on a full disk or in a folder that is read-only or deleted; what was there stays.
    """
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # a fixed short name: with that of `path` the longest permitted one would become too long
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=TEMPORARY, suffix=path.suffix)
        temporary = Path(name)
        try:
            _lock(handle)
            yield temporary
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):  # the folder may be gone
                temporary.unlink(missing_ok=True)
            raise
        finally:
            os.close(handle)


def _lock(handle: int, how: int = fcntl.LOCK_EX) -> bool:
    """Lock the open file or folder until it is closed, and return whether no other process has it locked.

    A file system without locks locks nothing.
    """
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn the system's errors into an `OutputError` that names the file that is written."""
    try:
        yield
    except OSError as error:
        raise OutputError(
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
def alone_in(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """No other process may enter this for the same folder until the block ends, or the process does, however it ends.

    With `shared`, others that share it too may: the shares of a fleet, which write different files. What a killed
    process has left half-written is removed, unless `shared`. Raises `InputError` where another process is in the
    folder.
    """
    handle = os.open(folder, os.O_RDONLY)
    until = time.monotonic() + ENDING
    try:
        while not _lock(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX):
            if time.monotonic() > until:
                raise InputError(
                    f"--out {folder}: another process is writing into this folder; wait for it, or give another folder"
                )
            time.sleep(0.02)
        if not shared:
            _remove_left(folder)
        yield
    finally:
        os.close(handle)


def _remove_left(folder: Path) -> None:
    """Remove what killed processes left half-written in the folder and below it, not what another is writing there."""
    for left in folder.rglob(f"{TEMPORARY}*"):
        with suppress(OSError):
            handle = os.open(left, os.O_RDONLY)
            try:
                if _lock(handle):
                    left.unlink()
            finally:
                os.close(handle)


def describe_error(error: OSError) -> str:
    """The system's reason in a few words, as `No space left on device`."""
    return os.strerror(error.errno) if error.errno else " ".join(str(error).split()) or type(error).__name__
