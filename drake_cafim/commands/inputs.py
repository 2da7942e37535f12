"""Recordings from the command line."""

from collections.abc import Sequence
from pathlib import Path

from drake_cafim.errors import InputError
from drake_cafim.recordings import read
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.scene import Scene

SUFFIXES = (".parquet", ".csv", ".npz", ".mcap", ".bag", ".db3", ".lcm")


def read_all(scene: Scene, paths: Sequence[str]) -> list[Recording]:
    """The recordings, names as given. Raises `InputError` for a path that is given twice or cannot be read."""
    for path in paths:
        if list(paths).count(path) > 1:
            raise InputError(f"{path}: the recording is given more than once")
    return [read(Path(path), scene.scenario.topics) for path in paths]


def in_folder(folder: Path) -> list[str]:
    """The recordings in a folder by name; hidden files are left out."""
    return sorted(str(p) for p in folder.iterdir() if p.suffix in SUFFIXES and not p.name.startswith("."))
