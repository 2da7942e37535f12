"""A published data set: where its files come from, how they become recordings, and the hash of the result."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.checks import cleaned
from drake_cafim.recordings.csv import read_csv
from drake_cafim.recordings.files import write
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

DECIMALS = 9  # of a column that are hashed: a nanometre, so that the last bits of a product do not matter


@dataclass(frozen=True)
class Run:
    """One recording of a set."""

    source: str  # path of its file in the set's repository
    sha256: str  # of the columns, see `content_hash`
    rows: tuple[int, int | None] = (0, None)  # of the file that are kept: from the first to before the second


@dataclass(frozen=True)
class PublishedSet:
    """A set whose files the user fetches from their own source."""

    name: str
    url: str
    commit: str
    licence: str
    runs: Mapping[str, Run]
    table: Callable[[Path, Run], dict[str, Array]]  # the columns of one run, `time` first

    def recording(self, folder: Path, run: str) -> Recording:
        """The run out of a checkout of the set's repository in `folder`, its hash checked.

        Raises `InputError` when the run or the file is not there, is not as published, or gives other columns.
        """
        if run not in self.runs:
            raise InputError(f"{self.name}: there is no run {run}; it has {', '.join(self.runs)}")
        path = folder / self.runs[run].source
        if not path.is_file():
            raise InputError(f"{path}: there is no such file, expected a checkout of {self.url} at {self.commit}")
        recording = cleaned(str(path), self.table(path, self.runs[run]))
        found, expected = content_hash(recording), self.runs[run].sha256
        if found != expected:
            raise InputError(
                f"{path}: run {run} of {self.name} has columns of sha256 {found}, expected {expected}: "
                f"not the file of commit {self.commit}"
            )
        return recording

    def convert(self, folder: Path, out: Path) -> list[Path]:
        """Write every run as `out/<run>.parquet`; the paths come back. Raises `InputError` as `recording`."""
        return [write(self.recording(folder, run), out / f"{run}.parquet") for run in self.runs]


def content_hash(recording: Recording) -> str:
    """sha256 of names and numbers, rounded to nine decimals, of `time` and then the columns by name."""
    digest = hashlib.sha256()
    columns = {"time": recording.time, **dict(sorted(recording.columns.items()))}
    for name, values in columns.items():
        rounded = np.round(values, DECIMALS) + 0.0  # + 0.0: one zero, not two
        digest.update(name.encode() + b"\0" + rounded.astype("<f8").tobytes())
    return digest.hexdigest()


def columns_of_csv(path: Path, run: Run, names: Mapping[str, str]) -> dict[str, Array]:
    """The columns `names` (the file's name to ours, time first) of a comma-separated file.

    Rows that repeat the time before them are dropped, `run.rows` are kept, time starts at zero; nothing else is
    changed. Raises `InputError` for a column that is not there.
    """
    table, _ = read_csv(path)
    missing = [name for name in names if name not in table]
    if missing:
        raise InputError(f"{path}: there is no column {missing[0]}; it has {', '.join(table)}")
    time = table[next(iter(names))]
    fresh = np.concatenate([[True], np.diff(time) != 0.0])
    columns = {new: table[old][fresh][slice(*run.rows)] for old, new in names.items()}
    return columns | {"time": columns["time"] - columns["time"][:1]}
