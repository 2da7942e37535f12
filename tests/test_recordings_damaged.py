"""Files that were cut or damaged give what they have, or are refused in one sentence."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.errors import InputError
from tests.bags.lcm_log import write_lcm
from tests.bags.written import TOPICS, WRITERS, messages, twin


@pytest.mark.parametrize("writer", ["rosbags, MCAP", "rosbags, SQLite", "rosbags, ROS 1", "mcap"])
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.95])
def test_a_bag_cut_in_the_middle(tmp_path: Path, writer: str, kept: float) -> None:
    expected = twin(2000)
    path = WRITERS[writer](tmp_path, messages(expected))
    file = next(child for child in path.iterdir() if child.suffix in (".mcap", ".db3")) if path.is_dir() else path
    file.write_bytes(file.read_bytes()[: int(kept * file.stat().st_size)])
    try:
        read = recordings.read(path, TOPICS)
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        # A ROS 1 bag keeps its index at the end; a recorder's first chunk is all that the others may lose.
        assert writer != "mcap" or kept < 0.1
        return
    assert any(("is cut" if "MCAP" in writer or writer == "mcap" else "damaged") in note for note in read.notes)
    n = len(read)
    assert 0.5 * kept * len(expected.time) < n and (kept > 0.9 or n < 0.75 * len(expected.time))
    common = np.isin(read.time, expected.time)
    assert common.all()
    rows = np.searchsorted(expected.time, read.time)
    for column, values in read.columns.items():
        there = ~np.isnan(values)
        assert np.array_equal(values[there], expected.columns[column][rows][there])


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """The bytes cut short, with some changed, or with some taken out of the middle."""
    whole = bytearray(data)
    where = int(rng.integers(len(whole)))
    kind = rng.integers(3)
    if kind == 0:
        return bytes(whole[:where])
    if kind == 1:
        whole[where] = int(rng.integers(256))
    else:
        whole[where : where + int(rng.integers(1, 200))] = b""
    return bytes(whole)


@pytest.mark.parametrize("name", [*WRITERS, "lcm", "parquet", "csv", "npz"])
def test_damaged_bytes_are_read_or_refused(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng(5)
    given = twin(60)
    if name in WRITERS:
        path = WRITERS[name](tmp_path, messages(given))
    elif name == "lcm":
        path = write_lcm(tmp_path / "a.lcm")
    elif name == "npz":
        path = tmp_path / "a.npz"
        np.savez_compressed(path, time=given.time, **given.columns)
    else:
        path = recordings.write(given, tmp_path / f"a.{name}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files * 12:
        whole = file.read_bytes()
        file.write_bytes(damaged(whole, rng))
        try:
            recordings.read(path, TOPICS if name in WRITERS else None)
        except InputError as error:
            assert str(path) in str(error) and "\n" not in str(error)
        file.write_bytes(whole)


def test_files_that_are_no_bag(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.db3", "a.bag", "a.lcm"):
        (tmp_path / name).write_bytes(b"this is a letter to my aunt, of some length " * 40)
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            recordings.read(tmp_path / name)
    sqlite3.connect(tmp_path / "empty.db3").execute("CREATE TABLE x (y)").connection.close()
    with pytest.raises(InputError, match="not a whole ROS 2 bag"):
        recordings.read(tmp_path / "empty.db3")
