"""Reading and writing of recordings, by the file's suffix, and checks of the path."""

from collections.abc import Iterable
from pathlib import Path

from drake_cafim.errors import InputError, check_type
from drake_cafim.output import describe_error, replacing
from drake_cafim.recordings.checks import clean
from drake_cafim.recordings.csv import read_csv, write_csv
from drake_cafim.recordings.gathering import MESSAGES, gather, reader_of
from drake_cafim.recordings.mcap_out import write_mcap
from drake_cafim.recordings.npz import read_npz
from drake_cafim.recordings.parquet import read_parquet, write_parquet
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.timing import timings
from drake_cafim.recordings.topics import Topics, check_topics, rename_columns

TABLES = (".parquet", ".csv", ".npz")
WRITERS = {".parquet": write_parquet, ".csv": write_csv, ".mcap": write_mcap}


def read(path: str | Path, topics: Topics | None = None) -> Recording:
    """The recording in the file at `path`, by its suffix.

    Tables: .parquet, .csv, .npz. Bags and logs: .mcap, a ROS 2 bag's folder or .db3, a ROS 1 .bag, an LCM log
    .lcm or .lcmlog. `topics` maps foreign names, as the scenario's section of that name (see
    `drake_cafim.recordings.topics`). Of several topics, the notes tell the rates and the offsets between their stamps.
    The whole table is in memory: 8 bytes for each number.

        recording = drake_cafim.read("run_3.mcap")
        recording["q.elbow"]          # (N,) rad, NaN where nothing was measured
        recording.notes               # defects of the file, and what was left out

    Raises `InputError`, one sentence that names the file and the column, what was found and what was expected.
    """
    check_type("path", path, (str, Path), "the name of a file")
    file, topics = Path(path), topics or {}
    check_path(file)
    if reader_of(file) is not None:
        gathered = gather(file, topics)
        table = gathered.table
        stamps = [str(timing) for timing in timings(table)] if len(table.series) > 1 else []
        return clean(str(path), table.table(), [*gathered.notes, *stamps])
    check_topics(topics, str(path))
    suffix = file.suffix.lower()
    if suffix == ".npz":
        columns, notes = read_npz(file, topics)
    else:
        columns, notes = read_parquet(file) if suffix == ".parquet" else read_csv(file)
        columns = rename_columns(str(path), columns, topics)
    return clean(str(path), columns, notes)


def write(recording: Recording, path: str | Path) -> Path:
    """Write the recording as .parquet, .csv or .mcap, by the suffix of `path`, and return the path.

    The file is replaced at the end, so that it is never incomplete. The same recording gives the same bytes. Raises
    `InputError` for a suffix that cannot be written.
    """
    check_type("recording", recording, Recording, "a Recording")
    check_type("path", path, (str, Path), "the name of a file")
    file = Path(path)
    check_writable(file)
    with replacing(file) as temporary:
        WRITERS[file.suffix.lower()](recording, temporary)
    return file


def check_writable(path: Path) -> None:
    """Raises `InputError` unless a recording can be written under this suffix."""
    if path.suffix.lower() not in WRITERS:
        raise InputError(f"{path}: cannot write suffix {path.suffix or '(none)'}, expected {_any(WRITERS)}")


def check_path(path: Path) -> None:
    """Raises `InputError` unless the path is a bag's folder, or a file of a known suffix that is not empty."""
    try:
        _check_path(path)
    except OSError as error:  # a name that is too long, a folder that may not be entered
        raise InputError(f"{path}: it cannot be read ({describe_error(error)}), expected a recording") from None


def _check_path(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir():
        if reader_of(path) is None:
            raise InputError(
                f"{path}: the folder is not a ROS 2 bag, it has neither a metadata.yaml nor .mcap or .db3 files"
            )
        return
    if path.suffix.lower() not in (*TABLES, *MESSAGES):
        found = path.suffix or "(none)"
        raise InputError(
            f"{path}: unknown suffix {found}, expected {_any((*TABLES, *MESSAGES))} or a ROS 2 bag's folder"
        )
    if not path.is_file():
        raise InputError(f"{path}: it is no regular file, expected a recording")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty, expected a recording")


def _any(suffixes: Iterable[str]) -> str:
    return ", ".join(suffixes)
