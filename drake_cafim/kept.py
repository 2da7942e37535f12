"""What a command has finished, on disk, so that one that was killed goes on where it ended.

A file for each finished piece of work, whole or not there: numbers alone, no code is read from them.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np

from drake_cafim.output import replacing, write_text
from drake_cafim.typing import Array

ABOUT = "about.json"
"""What the kept work is of: another command in the same folder begins anew."""
UNREADABLE = (BadZipFile, OSError, EOFError, ValueError, KeyError, TypeError, IndexError, AttributeError)
"""Errors of a kept file that is gone or damaged: its work is done again."""
Found = TypeVar("Found")


@dataclass(frozen=True)
class Kept:
    """Finished work in `folder`, by name; without a folder none is kept."""

    folder: Path | None = None
    about: str = ""

    @classmethod
    def open(cls, folder: Path, about: Mapping[str, Any], resume: bool) -> "Kept":
        """The work in `folder` where it is to be resumed and is of the same `about`, else an empty folder."""
        text = json.dumps(about, indent=1) + "\n"
        try:
            same = resume and (folder / ABOUT).read_text(encoding="utf-8") == text
        except UNREADABLE:
            same = False
        if not same:
            shutil.rmtree(folder, ignore_errors=True)
        return cls(folder, text)

    def close(self) -> None:
        """Remove what was kept: the results are there."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def read(self, name: str, parse: Callable[[Any], Found]) -> Found | None:
        """The work of that name as `parse` understands it; None where it is not there or damaged."""
        if self.folder is None:
            return None
        try:
            return parse(json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8")))
        except UNREADABLE:
            return None

    def write(self, name: str, content: Any) -> None:
        """Keep `content`, plain values, under that name; None is not kept."""
        if self.folder is not None and content is not None:
            self._say_of_what(self.folder)
            write_text(self.folder / f"{name}.json", json.dumps(content))

    def read_arrays(self, name: str, parse: Callable[[Mapping[str, Array]], Found]) -> Found | None:
        """As `read`, of arrays by name."""
        if self.folder is None:
            return None
        try:
            with (self.folder / f"{name}.npz").open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return parse(dict(arrays))
        except UNREADABLE:
            return None

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays under that name."""
        if self.folder is not None:
            self._say_of_what(self.folder)
            with replacing(self.folder / f"{name}.npz") as temporary:
                np.savez(temporary, **arrays)

    def _say_of_what(self, folder: Path) -> None:
        if not (folder / ABOUT).is_file():
            write_text(folder / ABOUT, self.about)


NOTHING_KEPT = Kept()
