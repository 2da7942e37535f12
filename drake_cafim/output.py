"""Atomic writing of output files (temporary name, then rename), and output folders of commands."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drake_cafim.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, renamed to `path` at the end of the block, removed if the block raises.

    The temporary name keeps the suffix, since writers choose their format by it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write `text` (UTF-8) to `path` atomically."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def prepare_folder(out: Path | None, command: str, *, resume: bool, overwrite: bool) -> Path:
    """The folder that a command writes to; by default the first free `cafim-out/<command>-<n>`.

    Raises `InputError` where `out` is a file, or contains files and neither `resume` nor `overwrite` is set.
    """
    if out is None:
        number = 1
        while Path("cafim-out", f"{command}-{number}").exists():
            number += 1
        out = Path("cafim-out", f"{command}-{number}")
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: there is a file of that name, expected a folder")
    if out.is_dir() and any(out.iterdir()) and not (resume or overwrite):
        raise InputError(f"--out {out}: the folder is not empty; give --resume or --overwrite, or another folder")
    out.mkdir(parents=True, exist_ok=True)
    return out
