"""The class `PublishedSet`: the source of a data set, its conversion to recordings, and the hashes of the result."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.checks import clean
from drake_cafim.recordings.csv import read_csv
from drake_cafim.recordings.files import write
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

DECIMALS = 9  # of each number that are hashed: the last bits of a product differ between machines


@dataclass(frozen=True)
class Run:
    """One recording of a set."""

    source: str  # path of its file in the set's repository
    sha256: str  # of the columns, see `content_hash`
    rows: tuple[int, int | None] = (0, None)  # of the file that are used: first, and one past the last


@dataclass(frozen=True)
class PublishedSet:
    """A published data set, whose files the user fetches from its repository."""

    name: str
    url: str
    commit: str
    licence: str
    runs: Mapping[str, Run]
    table: Callable[[Path, Run], dict[str, Array]]  # the columns of one run, `time` first

    def recording(self, folder: Path, run: str) -> Recording:
        """The recording of `run` from a checkout of the set's repository in `folder`.

        Raises `InputError` for an unknown run, a missing file, or columns whose hash is not that of the published ones.
        """
        if run not in self.runs:
            raise InputError(f"{self.name}: there is no run {run}; it has {', '.join(self.runs)}")
        path = folder / self.runs[run].source
        if not path.is_file():
            raise InputError(f"{path}: there is no such file, expected a checkout of {self.url} at {self.commit}")
        recording = clean(str(path), self.table(path, self.runs[run]))
        found, expected = content_hash(recording), self.runs[run].sha256
        if found != expected:
            raise InputError(
                f"{path}: run {run} of {self.name} has columns of sha256 {found}, expected {expected}: "
                f"not the file of commit {self.commit}"
            )
        return recording

    def convert(self, folder: Path, out: Path) -> list[Path]:
        """Write every run as `out/<run>.parquet` and return the paths. Raises `InputError` as `recording` does."""
        return [write(self.recording(folder, run), out / f"{run}.parquet") for run in self.runs]


def content_hash(recording: Recording) -> str:
    """sha256 of `time` and then the columns in the order of their names: each name, and its numbers to 9 decimals."""
    digest = hashlib.sha256()
    columns = {"time": recording.time, **dict(sorted(recording.columns.items()))}
    for name, values in columns.items():
        rounded = np.round(values, DECIMALS) + 0.0  # + 0.0 turns −0.0 into 0.0, which has other bytes
        digest.update(name.encode() + b"\0" + rounded.astype("<f8").tobytes())
    return digest.hexdigest()


def columns_of_csv(path: Path, run: Run, names: Mapping[str, str]) -> dict[str, Array]:
    """Columns of a comma-separated file under new names: `names` maps the file's to the recording's, time first.

    Rows that repeat the time of the row before are dropped, then `run.rows` are selected, and time starts at zero;
    nothing else is changed. Raises `InputError` for a column that the file lacks.
    """
    table, _ = read_csv(path)
    missing = [name for name in names if name not in table]
    if missing:
        raise InputError(f"{path}: there is no column {missing[0]}; it has {', '.join(table)}")
    time = table[next(iter(names))]
    fresh = np.concatenate([[True], np.diff(time) != 0.0])
    columns = {new: table[old][fresh][slice(*run.rows)] for old, new in names.items()}
    return columns | {"time": columns["time"] - columns["time"][:1]}
