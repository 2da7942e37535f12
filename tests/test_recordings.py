"""Recordings: what goes in comes out to the bit, and every bad file is refused or noted in one sentence."""

import os
import pickle
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings import Recording

SUFFIXES = [".parquet", ".csv"]


def table(samples: int = 200) -> dict[str, np.ndarray]:
    """A two-joint table with numbers that are hard to write down, missing measurements among them."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.001, 0.003, samples))
    q = rng.standard_normal(samples) * 10.0 ** rng.integers(-300, 300, samples)
    q[:4] = [0.0, -0.0, 5e-324, 1.7976931348623157e308]
    v = rng.standard_normal(samples)
    v[50:60] = np.nan
    return {"time": time, "q.elbow": q, "v.elbow": v, "u.elbow": np.round(rng.standard_normal(samples), 3)}


def recording(name: str = "a.parquet", samples: int = 200) -> Recording:
    columns = table(samples)
    return Recording(name=name, time=columns.pop("time"), columns=columns)


def put(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write any table, also one that no Recording would take."""
    if path.suffix == ".parquet":
        pyarrow.parquet.write_table(pyarrow.table(columns), path)
    else:
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(repr(float(cell)) for cell in row) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
    return path


def refusal(path: Path) -> str:
    """The one sentence that refuses the file; it names it and is one line."""
    with pytest.raises(InputError) as caught:
        recordings.read(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and len(message) < 400
    return message


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trip_to_the_bit(tmp_path: Path, suffix: str) -> None:
    given = recording()
    back = recordings.read(recordings.write(given, tmp_path / f"a{suffix}"))
    assert back.time.tobytes() == given.time.tobytes()
    assert list(back.columns) == list(given.columns)
    for column in given.columns:
        there = ~np.isnan(given.columns[column])
        assert np.array_equal(there, ~np.isnan(back.columns[column]))
        assert back.columns[column][there].tobytes() == given.columns[column][there].tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_same_data_same_bytes(tmp_path: Path, suffix: str) -> None:
    first = recordings.write(recording(), tmp_path / f"a{suffix}").read_bytes()
    second = recordings.write(recording(), tmp_path / f"b{suffix}").read_bytes()
    assert first == second


def test_float32_and_integers_are_read_as_they_are(tmp_path: Path) -> None:
    q = np.array([0.1, 0.2, 0.3], dtype=np.float32)
    path = put(tmp_path / "a.parquet", {"time": np.arange(3), "q.elbow": q})
    back = recordings.read(path)
    assert np.array_equal(back.columns["q.elbow"], q.astype(np.float64)) and back.time.dtype == np.float64


def test_helpers_name_what_is_there() -> None:
    time = np.arange(3.0)
    names = ["q.arm.elbow", "v.arm.elbow", "cmd.wrist", "wrench.wrist.fz", "u_cmd.elbow", "note"]
    names += [f"pose.ball.{c}" for c in recordings.POSE_COMPONENTS]
    given = Recording(name="a", time=time, columns=dict.fromkeys(names, time))
    assert given.joints("q") == ("arm.elbow",) and given.joints("cmd") == ("wrist",)
    assert given.wrench_sensors == ("wrist",) and given.bodies == ("ball",)
    assert given.other_columns == ("u_cmd.elbow", "note")
    assert given.pose("ball").shape == (3, 7) and given.matrix("q", ["arm.elbow"]).shape == (3, 1)
    with pytest.raises(InputError, match=r"no column wrench\.wrist\.fx; it has time, q\.arm\.elbow"):
        given.wrench("wrist")
    assert given.window(0.5, 2.0).time.tolist() == [1.0, 2.0] and given.duration == 2.0


def test_recording_is_frozen_and_travels_between_processes() -> None:
    given = recording()
    with pytest.raises(ValueError, match="read-only"):
        given.columns["q.elbow"][0] = 1.0
    assert np.array_equal(pickle.loads(pickle.dumps(given)).time, given.time)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nan_in_time_is_refused(tmp_path: Path, suffix: str) -> None:
    columns = table()
    columns["time"][7] = np.nan
    message = refusal(put(tmp_path / f"a{suffix}", columns))
    assert "column time holds nan in sample 8 of 200" in message


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_decreasing_time_is_refused(tmp_path: Path, suffix: str) -> None:
    columns = table()
    columns["time"] = np.concatenate([np.arange(100.0), np.arange(98.5, 198.5)])
    assert "decreases from 99.0 s to 98.5 s at sample 101" in refusal(put(tmp_path / f"a{suffix}", columns))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_column_says_which_are_there(tmp_path: Path, suffix: str) -> None:
    columns = table()
    del columns["time"]
    assert "no column time; it has q.elbow, v.elbow, u.elbow" in refusal(put(tmp_path / f"a{suffix}", columns))
    read = recordings.read(put(tmp_path / f"b{suffix}", table()))
    with pytest.raises(InputError, match=r"no column q\.shoulder; it has time, q\.elbow, v\.elbow, u\.elbow"):
        recordings.require(read, ["q.elbow", "q.shoulder"])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nothing_but_nan_in_a_needed_column(tmp_path: Path, suffix: str) -> None:
    columns = table() | {"q.elbow": np.full(200, np.nan)}
    read = recordings.read(put(tmp_path / f"a{suffix}", columns))
    assert any("q.elbow: nothing but NaN" in note for note in read.notes)
    with pytest.raises(InputError, match=r"column q\.elbow holds nothing but NaN"):
        read.matrix("q", ["elbow"])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_files_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.touch()
    assert "the file is empty" in refusal(path)
    put(path, {name: values[:0] for name, values in table().items()})
    assert "not one sample" in refusal(path)


@pytest.mark.parametrize("kept", [3, 40, 0.3, 0.7, 0.99])
def test_truncated_parquet_is_refused(tmp_path: Path, kept: float) -> None:
    whole = recordings.write(recording(), tmp_path / "a.parquet").read_bytes()
    cut = tmp_path / "cut.parquet"
    cut.write_bytes(whole[: int(kept if kept > 1 else kept * len(whole))])
    assert "not a whole Parquet file" in refusal(cut)


def test_paths_that_are_no_recording(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "absent.parquet")
    assert "not a ROS 2 bag" in refusal(tmp_path)
    (tmp_path / "a.xlsx").write_text("x")
    assert "unknown suffix .xlsx, expected .parquet, .csv" in refusal(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"cannot write suffix \.xlsx"):
        recordings.write(recording(), tmp_path / "b.xlsx")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_run_of_nan_is_noted_and_stays_nan(tmp_path: Path, suffix: str) -> None:
    columns = table()
    columns["u.elbow"][3] = np.inf
    read = recordings.read(put(tmp_path / f"a{suffix}", columns))
    start, end = columns["time"][50], columns["time"][59]
    assert f"v.elbow: no measurement in 10 samples, left out in {start:.6g} to {end:.6g} s (10)" in read.notes
    assert any(note.startswith("u.elbow: no measurement in 1 samples") for note in read.notes)
    assert np.isnan(read.columns["v.elbow"][50:60]).all() and np.isnan(read.columns["u.elbow"][3])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_repeated_stamp_is_left_out_and_noted(tmp_path: Path, suffix: str) -> None:
    columns = {"time": np.array([0.0, 0.1, 0.1, 0.2, 0.3]), "q.elbow": np.arange(5.0)}
    read = recordings.read(put(tmp_path / f"a{suffix}", columns))
    assert read.columns["q.elbow"].tolist() == [0.0, 1.0, 3.0, 4.0]
    assert read.notes == ("time: 1 row that repeats the stamp of the row before, left out at 0.1 s",)


def test_a_gap_in_time_is_noted() -> None:
    time = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)])
    read = recordings.clean("a", {"time": time, "q.elbow": time})
    assert read.notes == ("time: no samples in 0.99 to 2 s, where the median step is 0.01 s",)


def test_csv_of_other_hands(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbf# time;q.elbow;label;\r\n0;1e-3;a;\r\n1;;b;\r\n2;NaN;caf\xe9;\r\n3;4;d;")
    read = recordings.read(path)
    assert read.time.tolist() == [0.0, 1.0, 2.0, 3.0] and read.columns["q.elbow"][3] == 4.0
    assert np.isnan(read.columns["q.elbow"][1:3]).all() and list(read.columns) == ["q.elbow"]
    assert "label: holds string, not numbers, left alone" in read.notes


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time,q.elbow\n0,1\n1,oops\n", "column q.elbow holds 'oops' in sample 2, expected a number"),
        ("time,q.elbow\n0,1\n1\n2,3\n", "line 3 has 1 cells, expected 2"),
        ("time,q.elbow\n0,1\n1,2,3\n", "line 3 has 3 cells, expected 2"),
        ("time,q.elbow,q.elbow\n0,1,2\n", "column q.elbow occurs twice in the header"),
        ("\n\n", "the first line is no header"),
        ("time q.elbow\n0 1\n", "the header is 'time q.elbow', expected names separated by comma"),
        ("time,q.elbow", "not one sample"),
        ("0,1\n1,2\n", "no column time; it has 0, 1"),
    ],
)
def test_csv_that_is_no_table(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert expected in refusal(path)


def test_csv_with_its_last_line_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,q.elbow\n0,1\n1,2\n2")
    read = recordings.read(path)
    assert read.time.tolist() == [0.0, 1.0]
    assert read.notes == ("the last line was cut short (1 of 2 cells), left out",)


def test_parquet_signal_that_is_no_number(tmp_path: Path) -> None:
    path = put(tmp_path / "a.parquet", {"time": np.arange(2.0), "q.elbow": np.array(["a", "b"])})
    assert "column q.elbow holds string, expected numbers" in refusal(path)


def test_stamps_of_a_data_frame_become_seconds(tmp_path: Path) -> None:
    stamps = np.array([1_700_000_000_000_000_001, 1_700_000_000_002_000_002], dtype="datetime64[ns]")
    read = recordings.read(put(tmp_path / "a.parquet", {"time": stamps, "q.elbow": np.zeros(2)}))
    assert read.time.tolist() == [0.0, 0.002000001] and "seconds since the first" in read.notes[0]


def sweep(amplitude: float, samples: int = 2000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time = np.linspace(0.0, 4.0, samples)
    return time, amplitude * np.sin(2.0 * time), 2.0 * amplitude * np.cos(2.0 * time)


def test_degrees_are_told_by_the_limits() -> None:
    time, q, _ = sweep(1.2)
    limits = {"elbow": (-2.0, 2.0)}
    radians = Recording(name="a", time=time, columns={"q.elbow": q})
    degrees = Recording(name="a", time=time, columns={"q.elbow": np.degrees(q)})
    assert recordings.unit_mistakes(radians, limits) == ()
    with pytest.raises(InputError, match=r"column q.elbow runs from .* as degrees would; expected rad"):
        recordings.unit_mistakes(degrees, limits)
    assert recordings.unit_mistakes(degrees, {"elbow": (-np.inf, np.inf)}) == ()
    slightly_over = Recording(name="a", time=time, columns={"q.elbow": 2.0 * q})
    assert recordings.unit_mistakes(slightly_over, limits) == ()
    both = Recording(name="a", time=time, columns={"q.elbow": np.degrees(q), "v.elbow": np.degrees(sweep(1.2)[2])})
    with pytest.raises(InputError, match="as degrees would"):
        recordings.unit_mistakes(both, limits)


def test_degrees_are_told_by_the_velocity() -> None:
    time, q, v = sweep(0.02)
    v = np.round(v / 0.011) * 0.011 + 0.01  # as coarse and biased as a real drive
    unlimited = {"elbow": (-np.inf, np.inf)}
    wrong_q = Recording(name="a", time=time, columns={"q.elbow": np.degrees(q), "v.elbow": v})
    wrong_v = Recording(name="a", time=time, columns={"q.elbow": q, "v.elbow": np.degrees(v)})
    right = Recording(name="a", time=time, columns={"q.elbow": q, "v.elbow": v})
    assert "column q.elbow moves" in recordings.unit_mistakes(wrong_q, unlimited)[0]
    assert "column v.elbow" in recordings.unit_mistakes(wrong_v, unlimited)[0]
    assert recordings.unit_mistakes(right, unlimited) == ()
    for counts, times in ((652.0, "642"), (0.159, "0.157"), (-8.0, "-7.88")):
        counted = replace(right, columns={**right.columns, "q.elbow": counts * right["q.elbow"]})
        [told] = recordings.unit_mistakes(counted, unlimited)
        assert f"column q.elbow moves {times} times as far as the integral of v.elbow; expected rad" in told
    weak = replace(right, columns={**right.columns, "v.elbow": 0.5 * right["v.elbow"]})
    assert recordings.unit_mistakes(weak, unlimited) == ()


WRITER = """
import sys, time
from pathlib import Path
import numpy as np
from drake_cafim import recordings
from drake_cafim.recordings import files
path = Path(sys.argv[1])
def slow(recording, temporary):
    with temporary.open("wb") as file:
        file.write(b"half of it")
        file.flush()
        print("half", flush=True)
        time.sleep(60)
files.WRITERS = {path.suffix: slow}
recordings.write(recordings.Recording(name="b", time=np.arange(9.0), columns={}), path)
"""


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_kill_in_the_middle_leaves_no_half_file(tmp_path: Path, suffix: str) -> None:
    absent, present = tmp_path / f"absent{suffix}", recordings.write(recording(), tmp_path / f"a{suffix}")
    before = present.read_bytes()
    for path in (absent, present):
        process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
        assert process.stdout is not None and process.stdout.readline() == b"half\n"
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    assert not absent.exists() and present.read_bytes() == before


def test_the_real_sets_are_read(data_folder: Path) -> None:
    files = sorted((data_folder / "data").glob("*/runs/*.parquet"))
    assert files
    for path in files:
        read = recordings.read(path)
        assert len(read) > 50 and read.other_columns != tuple(read.columns)
