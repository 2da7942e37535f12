"""Reading and writing by suffix; what a path itself can have wrong."""

from collections.abc import Callable, Iterable
from pathlib import Path

from drake_cafim.errors import InputError
from drake_cafim.output import replacing
from drake_cafim.recordings.checks import cleaned
from drake_cafim.recordings.csv import read_csv, write_csv
from drake_cafim.recordings.parquet import read_parquet, write_parquet
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

Reader = Callable[[Path], tuple[dict[str, Array], list[str]]]

READERS: dict[str, Reader] = {".parquet": read_parquet, ".csv": read_csv}
WRITERS: dict[str, Callable[[Recording, Path], None]] = {".parquet": write_parquet, ".csv": write_csv}


def read(path: str | Path) -> Recording:
    """The recording in the file, by its suffix: .parquet or .csv.

    Raises `InputError`, one sentence naming file, column, what was found and what was expected.
    """
    file = Path(path)
    check_path(file, tuple(READERS))
    table, notes = READERS[file.suffix.lower()](file)
    return cleaned(str(path), table, notes)


def write(recording: Recording, path: str | Path) -> Path:
    """Write the recording whole or not at all, by suffix: .parquet or .csv; the path comes back.

    The same recording gives the same bytes. Raises `InputError` for a suffix that cannot be written.
    """
    file = Path(path)
    if file.suffix.lower() not in WRITERS:
        raise InputError(f"{file}: cannot write suffix {file.suffix or '(none)'}, expected {_any(WRITERS)}")
    with replacing(file) as temporary:
        WRITERS[file.suffix.lower()](recording, temporary)
    return file


def check_path(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raises `InputError` unless the path is a file that is not empty and has one of the suffixes."""
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir():
        raise InputError(f"{path}: a folder that is no ROS 2 bag, it has no metadata.yaml")
    if path.suffix.lower() not in suffixes:
        found = path.suffix or "(none)"
        raise InputError(f"{path}: unknown suffix {found}, expected {_any(suffixes)} or a ROS 2 bag's folder")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty, expected a table with a column time")


def _any(suffixes: Iterable[str]) -> str:
    return ", ".join(suffixes)
