"""Reads the recordings that the command line names."""

import os
from collections.abc import Sequence
from pathlib import Path

from drake_cafim.errors import InputError
from drake_cafim.recordings import read
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene


def read_all(scene: Scene, paths: Sequence[str]) -> list[Recording]:
    """The recordings, names as given. Raises `InputError` for a file that is given twice or cannot be read."""
    refuse_repeats(paths)
    return [read(Path(path), scene.scenario.topics) for path in paths]


def refuse_repeats(recordings: Sequence[str], held_out: Sequence[str] = ()) -> None:
    """Raises `InputError` for a file that is given twice, however its path is written."""
    known: dict[str, tuple[str, str]] = {}
    for kind, paths in (("--recording", recordings), ("--held-out", held_out)):
        for path in paths:
            before, other = known.setdefault(os.path.realpath(path), (kind, ""))
            if other:
                same = f" ({other} is the same file)" if other != path else ""
                if before != kind:
                    raise InputError(f"{path}: given as --recording and as --held-out{same}, expected one of them")
                raise InputError(f"{path}: the recording is given more than once{same}, expected each file once")
            known[os.path.realpath(path)] = (kind, path)


def refuse_thrown(scene: Scene, command: str) -> None:
    """Raises `InputError` where the scene is a thrown body, of which `command` has nothing to move or to draw."""
    if scene.tree.floating:
        raise InputError(
            f"{scene.name}: {command} is of robots, expected a model with joints; a thrown body can be diagnosed and "
            "estimated"
        )
