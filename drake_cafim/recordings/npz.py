"""Reading of NumPy .npz archives: one-dimensional arrays are columns, two-dimensional ones need `topics:`."""

import math
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.limits import check_columns, check_size
from drake_cafim.recordings.topics import Topic, Topics
from drake_cafim.typing import Array

# What NumPy and the zip library raise on archives that are truncated or damaged, or hold Python objects.
UNREADABLE = (
    *(zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, AttributeError),
    *(KeyError, NotImplementedError, RuntimeError, MemoryError, SyntaxError, TypeError, IndexError, OverflowError),
    struct.error,
)
TIMES = ("time", "t", "times", "sample_times")  # usual names of VectorLog.sample_times()


def read_npz(path: Path, topics: Topics) -> tuple[dict[str, Array], list[str]]:
    """The columns of the archive by name, and a note for each array that is left out.

    A two-dimensional array is (n, N) as `VectorLog.data()`, or (N, n); it is left out unless `topics` names its n
    columns. Raises `InputError` for a truncated archive, and for shapes that do not fit.
    """
    arrays = _arrays(path)
    missing = [key for key in topics if key not in arrays]
    if missing:
        raise InputError(f"{path}: topics: there is no array {missing[0]}; it has {', '.join(arrays)}")
    times = [key for key, how in topics.items() if how.columns == ["time"]]
    times += [key for key in TIMES if key in arrays]
    if not times:
        raise InputError(f"{path}: there is no array {' or '.join(TIMES)}; it has {', '.join(arrays) or 'none'}")
    table: dict[str, Array] = {}
    notes: list[str] = []
    samples = arrays[times[0]].size
    for key, values in arrays.items():
        how = Topic(columns=["time"]) if key == times[0] and key not in topics else topics.get(key, Topic())
        if values.dtype.kind not in "fiub":
            notes.append(f"{key}: holds {values.dtype}, not numbers, left alone")
        elif values.ndim == 1 or key == times[0]:
            _put(path, table, how.columns or [key], values.reshape(1, -1), samples, how.scale, key)
        elif values.ndim == 2 and how.columns:
            _put(path, table, how.columns, _rows(path, key, values, len(how.columns), samples), samples, how.scale, key)
        else:
            notes.append(f"{key}: an array of shape {values.shape} without columns: in topics:, left alone")
    return table, notes


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """The plain arrays of the archive; members that are none are not read, and none beyond what it can hold."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
            check_columns(str(path), len(members))
            check_size(path, sum(member.file_size for member in members))
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    except UNREADABLE as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not a whole .npz archive of plain arrays ({why})") from error


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """The array in a member. Raises `ValueError` where its header promises more than the member holds."""
    with archive.open(member) as content:
        version = np.lib.format.read_magic(content)
        read_header = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}.get(version[0])
        if read_header is None:
            raise ValueError(f"{member.filename} has the unknown version {version[0]}.{version[1]}")
        shape, _, dtype = read_header(content)
        if math.prod(shape) * dtype.itemsize > member.file_size or any(length < 0 for length in shape):
            raise ValueError(
                f"{member.filename} promises an array of shape {shape}, but holds {member.file_size} bytes"
            )
    with archive.open(member) as content:
        array: np.ndarray = np.lib.format.read_array(content, allow_pickle=False)
        return array


def _rows(path: Path, key: str, values: np.ndarray, columns: int, samples: int) -> np.ndarray:
    """The array as (columns, samples); where both are equal, it is taken to be so already."""
    if values.shape == (columns, samples):
        return values
    if values.shape == (samples, columns):
        return values.T
    raise InputError(
        f"{path}: array {key} has shape {values.shape}, expected ({columns}, {samples}) or ({samples}, {columns})"
    )


def _put(
    path: Path, table: dict[str, Array], columns: list[str], rows: np.ndarray, samples: int, scale: float, key: str
) -> None:
    if rows.shape[1] != samples:
        raise InputError(f"{path}: array {key} holds {rows.shape[1]} numbers, expected {samples} like time")
    if rows.shape[0] != len(columns):
        raise InputError(f"{path}: array {key} is one column, topics: gives it {len(columns)}")
    for column, values in zip(columns, rows, strict=True):
        if column in table:
            raise InputError(f"{path}: two arrays become the column {column}, {key} is the second")
        if column:
            numbers = values.astype(np.float64)
            table[column] = numbers if scale == 1.0 else numbers * scale
