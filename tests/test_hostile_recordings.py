"""Recordings that claim more than they hold, or hold what no recorder writes: one sentence, and little memory."""

import io
import resource
import sqlite3
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from mcap.writer import Writer

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.topics import Topic


def refusal(path: Path, match: str, topics: dict[str, Topic] | None = None) -> None:
    """Checks that the file is refused in one short line that names it, with little memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=match) as raised:
        recordings.read(path, topics)
    text = str(raised.value)
    assert path.name in text and "\n" not in text and len(text) < 500
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 * 1024  # kB


def test_a_parquet_file_that_unpacks_to_half_a_gigabyte(tmp_path: Path) -> None:
    path = tmp_path / "bomb.parquet"
    zeros = pyarrow.array(np.zeros(2**17))
    with pyarrow.parquet.ParquetWriter(path, pyarrow.schema([("time", pyarrow.float64())]), compression="zstd") as out:
        for _ in range(480):
            out.write_table(pyarrow.table({"time": zeros}))
    assert path.stat().st_size < 2**20
    refusal(path, "claims 480 MiB of numbers")


def test_a_column_without_numbers_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "labels.parquet"
    text = pyarrow.DictionaryArray.from_arrays(pyarrow.array(np.zeros(4096, np.int32)), ["x" * 65536])
    table = pyarrow.table({"time": np.arange(4096.0), "label": text, "q.a": np.arange(4096.0)})
    pyarrow.parquet.write_table(table, path)
    tracemalloc.start()
    read = recordings.read(path)
    assert tracemalloc.get_traced_memory()[1] < 50 * 2**20
    tracemalloc.stop()
    assert len(read) == 4096 and any("label" in note for note in read.notes)


@pytest.mark.parametrize("seed", range(40))
def test_damaged_metadata_of_parquet(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "a.parquet"
    time = np.arange(50.0)
    recordings.write(Recording("a", time, {"q.a": time, "u.a": time}), path)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    length = int.from_bytes(data[-8:-4], "little")
    for _ in range(3):
        data[len(data) - 8 - int(rng.integers(1, length))] = int(rng.integers(256))
    path.write_bytes(data)
    try:
        recordings.read(path)
    except InputError as error:
        assert str(path) in str(error)


def npz(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_npz_with_foreign_members(tmp_path: Path) -> None:
    time = np.arange(20.0)
    path = npz(tmp_path / "a.npz", {"README.txt": b"hello", "time.npy": npy(time), "q.a.npy": npy(time)})
    assert list(recordings.read(path).columns) == ["q.a"]


@pytest.mark.parametrize("shape", ["(1000000000000000,)", "(-5,)", "(99999999999999999999999,)", "(True,)", "(0, 1e9)"])
def test_npz_of_absurd_shape(tmp_path: Path, shape: str) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(64)
    path = npz(tmp_path / "a.npz", {"time.npy": npy(np.arange(8.0)), "q.a.npy": content})
    try:
        recordings.read(path)
    except InputError as error:
        assert "a.npz" in str(error)


def test_npz_of_a_gigabyte_behind_a_megabyte(tmp_path: Path) -> None:
    zeros = npy(np.zeros(2**22))  # 32 MiB
    path = npz(tmp_path / "a.npz", {f"x{i}.npy": zeros for i in range(10)})
    assert path.stat().st_size < 2**19
    refusal(path, "claims 320 MiB of numbers")


def test_csv_of_too_many_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(",".join(["time", *(f"c{i}" for i in range(100_000))]) + "\n" + ",".join(["0"] * 100_001) + "\n")
    refusal(path, "it has 100001 columns, expected at most 10000")


def test_an_mcap_record_of_a_huge_declared_length(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x05" + struct.pack("<Q", 255 * 2**20) + bytes(100))
    refusal(path, "not an MCAP file")
    chunk = struct.pack("<QQQI", 0, 1, 2**62, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", 4) + bytes(4)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    whole = path.read_bytes()
    path.write_bytes(whole[:8] + b"\x06" + struct.pack("<Q", len(chunk)) + chunk + whole[8:])
    refusal(path, "no message")


@pytest.mark.parametrize("length", [2**48, 2**62, 2**64 - 1])
def test_an_mcap_field_of_a_huge_declared_length(tmp_path: Path, length: int) -> None:
    path = tmp_path / "a.mcap"
    chunk = struct.pack("<QQQI", 0, 1, 4, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", length) + bytes(4)
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(chunk)) + chunk)
    refusal(path, "no message")


BAG = """CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles);
INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr', '');
INSERT INTO topics VALUES (2, NULL, 5, x'00', '');"""


@pytest.mark.parametrize(
    "rows",
    [
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data);"
        "INSERT INTO messages VALUES (1, 1, NULL, NULL), (2, 1, 'soon', 'text'), (3, NULL, 1, 1000000000),"
        "(4, 2, 1, x'00'),"
        "(5, 1, 1.5, x'00'), (6, 1, 9223372036854775807, x'0001000000000000');",
        "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
        "SELECT 1 AS topic_id, i AS timestamp, x'00' AS data FROM n;",
        "CREATE TABLE m (id); INSERT INTO m VALUES (1); "
        "CREATE TABLE messages (topic_id, timestamp, data AS (zeroblob(1000000000)), x);"
        "INSERT INTO messages (topic_id, timestamp, x) VALUES (1, 1, 1);",
        "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data);",
    ],
    ids=["null", "view", "generated", "virtual"],
)
def test_sqlite_that_no_recorder_writes(tmp_path: Path, rows: str) -> None:
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.executescript(BAG + rows)
    database.close()
    refusal(path, "a.db3: (no message|messages is a view|not a whole)")


@pytest.mark.parametrize(
    "metadata",
    [
        "null",
        "5",
        "rosbag2_bagfile_information: null",
        "rosbag2_bagfile_information: {compression_mode: null, relative_file_paths: null}",
        "rosbag2_bagfile_information: {compression_mode: 5, relative_file_paths: [1, null, {a: b}]}",
        "rosbag2_bagfile_information: {relative_file_paths: 7}",
        "rosbag2_bagfile_information: {compression_mode: FILE, relative_file_paths: [../../etc/passwd]}",
        "rosbag2_bagfile_information: {relative_file_paths: [" + 300 * "a" + "]}",
        "rosbag2_bagfile_information: &a [*a]",
        "rosbag2_bagfile_information: " + "9" * 5000,
    ],
)
def test_metadata_of_other_types(tmp_path: Path, metadata: str) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text(metadata)
    refusal(tmp_path / "bag", "bag")


def test_periods_and_paths_beyond_reason(tmp_path: Path) -> None:
    recording = Recording("a", np.arange(20.0), {"q.a": np.arange(20.0)})
    with pytest.raises(InputError, match=r"a period of 1e-12 s makes more than 1e\+07 samples"):
        recordings.resample(recording, 1e-12)
    with pytest.raises(InputError, match="File name too long") as raised:
        recordings.read(tmp_path / ("long" * 1250 + ".csv"))
    assert len(str(raised.value)) < 500
