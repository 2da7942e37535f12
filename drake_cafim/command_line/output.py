"""Where a command writes: its folder, its progress and its result."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from drake_cafim.output import alone_in, prepare_folder

FOLDER = "drake_cafim.folder"
"""Key of click's context for the folder that the command writes to."""


def open_folder(out: Path | None, command: str, *, resume: bool, overwrite: bool, shared: bool = False) -> Path:
    """The folder that a command alone writes to, or those that share it; removed at the end if nothing was written."""
    folder = prepare_folder(out, command, resume=resume, overwrite=overwrite)

    def leave_nothing_empty() -> None:
        with suppress(OSError):  # not empty
            folder.rmdir()

    context = click.get_current_context()
    context.call_on_close(leave_nothing_empty)
    context.with_resource(alone_in(folder, shared=shared))
    context.meta[FOLDER] = folder
    return folder


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """A function that shows progress on stderr: one line that changes, or a line per stage where it is no terminal.

    A text that ends with a line break stays where it is written.
    """
    if not sys.stderr.isatty():
        yield lambda text: click.echo(f"cafim: {text} ..." if text[-1:] != "\n" else f"cafim: {text[:-1]}", err=True)
        return
    with tqdm(bar_format="{elapsed} {desc}", file=sys.stderr, leave=False) as bar:

        def show(text: str) -> None:
            if text.endswith("\n"):
                bar.write(text[:-1], file=sys.stderr)
            else:
                bar.set_description_str(text)

        yield show


def print_result(result: Any, as_json: bool, text: str) -> None:
    """Prints the result as JSON, or the text that says it."""
    click.echo(json.dumps(result, indent=1, ensure_ascii=False) if as_json else text)
