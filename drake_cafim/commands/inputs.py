"""Reads the recordings and reports that the command line names."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
    known: dict[Path, tuple[str, str]] = {}
    for kind, paths in (("--recording", recordings), ("--held-out", held_out)):
        for path in paths:
            before, other = known.setdefault(Path(path).resolve(), (kind, ""))
            if other:
                same = f" ({other} is the same file)" if other != path else ""
                if before != kind:
                    raise InputError(f"{path}: given as --recording and as --held-out{same}, expected one of them")
                raise InputError(f"{path}: the recording is given more than once{same}, expected each file once")
            known[Path(path).resolve()] = (kind, path)


def refuse_thrown(scene: Scene, command: str) -> None:
    """Raises `InputError` where the scene is a thrown body, of which `command` has nothing to move or to draw."""
    if scene.tree.floating:
        raise InputError(
            f"{scene.name}: {command} is of robots, expected a model with joints; a thrown body can be diagnosed and "
            "estimated"
        )


def report_file(path: Path) -> Path:
    """The report.json that `path` is, or that is in the folder `path`."""
    return path / "report.json" if path.is_dir() else path


def read_report(path: Path, source: str) -> dict[str, Any]:
    """The report in the file `path`, called `source` in messages. Raises `InputError` for a file that is no report."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{source}: it cannot be read ({error.strerror}), expected a report.json") from None
    except ValueError as error:
        raise InputError(f"{source}: it is no JSON ({error}), expected a report.json") from None
    if not isinstance(content, dict) or not str(content.get("schema", "")).startswith("drake_cafim.report/"):
        raise InputError(f"{source}: its schema is not drake_cafim.report/1, expected a report.json")
    return content
