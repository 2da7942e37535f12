"""Foreign tables: column maps for CSV, .npz archives, Drake's VectorLogSink, resampling when asked."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, Sine

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings import Recording, Topic

DEGREE = np.pi / 180.0


def test_csv_with_a_column_map(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("stamp_ms,Elbow angle [deg],mood\n0,90,1\n2,180,2\n")
    topics = {
        "stamp_ms": Topic(columns=["time"], scale=1e-3),
        "Elbow angle [deg]": Topic(columns=["q.elbow"], scale=DEGREE),
    }
    read = recordings.read(path, topics)
    assert read.time.tolist() == [0.0, 0.002] and read.columns["q.elbow"].tolist() == [90 * DEGREE, 180 * DEGREE]
    assert read.other_columns == ("mood",)
    with pytest.raises(InputError, match=r"no column absent; it has stamp_ms, Elbow angle \[deg\], mood"):
        recordings.read(path, topics | {"absent": Topic(columns=["v.elbow"])})
    with pytest.raises(InputError, match="two columns become mood"):
        recordings.read(path, topics | {"Elbow angle [deg]": Topic(columns=["mood"])})


def test_npz_of_columns_and_of_a_vector_log(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 11)
    x = np.vstack([np.sin(t), np.cos(t)])
    names = {"x": Topic(columns=["q.elbow", "v.elbow"])}
    np.savez(tmp_path / "a.npz", **{"time": t, "q.elbow": x[0], "v.elbow": x[1]})
    np.savez(tmp_path / "b.npz", t=t, x=x, comment=np.array("hello"))
    np.savez_compressed(tmp_path / "c.npz", t=t[:, None], x=x.T)
    for name, topics in (("a", {}), ("b", names), ("c", names)):
        read = recordings.read(tmp_path / f"{name}.npz", topics)
        assert np.array_equal(read.matrix("q", ["elbow"])[:, 0], x[0]), name
        assert np.array_equal(read.time, t) and np.array_equal(read.columns["v.elbow"], x[1]), name
    left = recordings.read(tmp_path / "b.npz")
    assert any("x: an array of shape (2, 11) without columns" in note for note in left.notes)
    assert any("comment: holds" in note for note in left.notes)


@pytest.mark.parametrize(
    ("arrays", "topics", "expected"),
    [
        ({"q.a": np.zeros(3)}, {}, "no array time or t"),
        ({"t": np.arange(3.0), "q.a": np.zeros(4)}, {}, "array q.a holds 4 numbers, expected 3"),
        ({"t": np.arange(3.0)}, {"x": Topic(columns=["q.a"])}, "no array x; it has t"),
        ({"t": np.arange(3.0), "x": np.zeros((2, 4))}, {"x": Topic(columns=["a", "b"])}, r"shape \(2, 4\)"),
        ({"t": np.arange(3.0), "x": np.zeros(3)}, {"x": Topic(columns=["a", "b"])}, "gives it 2"),
        ({"t": np.arange(3.0), "x": np.array([{}, 1, 2])}, {}, "not a whole .npz archive of plain arrays"),
    ],
)
def test_npz_that_does_not_fit(
    tmp_path: Path, arrays: dict[str, np.ndarray], topics: dict[str, Topic], expected: str
) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=expected):
        recordings.read(tmp_path / "a.npz", topics)


def test_npz_that_was_cut(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.arange(1000.0))
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:4000])
    with pytest.raises(InputError, match=r"not a whole \.npz archive"):
        recordings.read(tmp_path / "a.npz")


def test_vector_log_sink() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(amplitudes=[1.0, 2.0], frequencies=[1.0, 1.0], phases=[0.0, 0.0]))
    sink = LogVectorOutput(source.get_output_port(0), builder, publish_period=0.125)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    log = sink.FindLog(simulator.get_context())
    read = recordings.from_vector_log(log, ["q.a", ""])
    assert read.time.tolist() == np.arange(0.0, 1.01, 0.125).tolist()
    assert np.allclose(read.columns["q.a"], np.sin(read.time), atol=1e-12) and list(read.columns) == ["q.a"]
    with pytest.raises(InputError, match="holds 2 elements, expected 1"):
        recordings.from_vector_log(log, ["q.a"])


def test_resampling_holds_efforts_and_bridges_no_gap() -> None:
    time = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(3.0, 4.05, 0.1)])
    given = Recording(name="a", time=time, columns={"q.a": 2.0 * time, "u.a": np.floor(10 * time + 1e-6)})
    even = recordings.resample(given, 0.05)
    assert np.allclose(np.diff(even.time), 0.05) and "resampled" in even.notes[-1]
    gap = (even.time > 0.9 + 1e-9) & (even.time < 3.0 - 1e-9)
    assert np.isnan(even.columns["q.a"][gap]).all() and not np.isnan(even.columns["q.a"][~gap]).any()
    assert np.allclose(even.columns["q.a"][~gap], 2.0 * even.time[~gap])
    assert even.columns["u.a"][:4].tolist() == [0.0, 0.0, 1.0, 1.0]
    with pytest.raises(InputError, match="expected it to be positive"):
        recordings.resample(given, 0.0)


def test_resampled_quaternions_take_the_shorter_arc() -> None:
    time = np.array([0.0, 1.0])
    q = np.array([[1.0, 0.0, 0.0, 0.0], [-np.cos(0.1), -np.sin(0.1), 0.0, 0.0]])
    names = [f"pose.b.{component}" for component in ("qw", "qx", "qy", "qz")]
    given = Recording(name="a", time=time, columns=dict(zip(names, q.T, strict=True)))
    middle = recordings.resample(given, 0.5).matrix("pose.b", ["qw", "qx"])[1]
    assert np.allclose(middle, [np.cos(0.05), np.sin(0.05)], atol=1e-12)


def test_describe_and_convert_a_table(tmp_path: Path) -> None:
    given = Recording(name="a", time=np.arange(4.0), columns={"q.a": np.array([1.0, np.nan, 3.0, 4.0])})
    recordings.write(given, tmp_path / "a.csv")
    found = recordings.convert(tmp_path / "a.csv", tmp_path / "a.parquet")
    assert found.columns == ("q.a",) and found.samples == 4 and found.median_step == 1.0
    assert "note: q.a: no measurement in 1 samples, left out in 1 s (1)" in str(found)
    assert recordings.read(tmp_path / "a.parquet").columns["q.a"][2] == 3.0
