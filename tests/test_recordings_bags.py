"""Bags written with public libraries are read equal to their Parquet twin to the bit."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import Recording, Scene, diagnose, recordings
from drake_cafim.commands.importing import import_command
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record, stiff_grease
from drake_cafim.errors import InputError
from drake_cafim.recordings import Topic
from tests.bags.written import (
    ROS2,
    TOPICS,
    WRITERS,
    Mcap2Writer,
    assert_equal_to_the_bit,
    joint_bag,
    messages,
    twin,
    write_mcap2,
)


@pytest.mark.parametrize("writer", WRITERS)
def test_a_bag_is_equal_to_its_parquet_twin(tmp_path: Path, writer: str) -> None:
    expected = twin()
    recordings.write(expected, tmp_path / "twin.parquet")
    path = WRITERS[writer](tmp_path, messages(expected))
    assert_equal_to_the_bit(recordings.read(path, TOPICS), recordings.read(tmp_path / "twin.parquet"))


@pytest.mark.parametrize("writer", ["rosbags, SQLite", "mcap"])
def test_convert_writes_the_twin_s_bytes(tmp_path: Path, writer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = WRITERS[writer](tmp_path, messages(twin()))
    whole = recordings.read(path, TOPICS)
    recordings.write(whole, tmp_path / "whole.parquet")
    found = recordings.convert(path, tmp_path / "piecewise.parquet", TOPICS)
    assert (tmp_path / "piecewise.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    timing = [str(topic) for topic in found.topics]
    assert found.notes == tuple(note for note in whole.notes if note not in timing) and found.samples == len(whole)
    assert set(timing) <= set(whole.notes)
    monkeypatch.setattr("drake_cafim.recordings.joining.BLOCK_ROWS", 7)
    monkeypatch.setattr("drake_cafim.recordings.joining.JoinedTable.blocks.__defaults__", (7,))
    recordings.convert(path, tmp_path / "small_pieces.parquet", TOPICS)
    assert_equal_to_the_bit(recordings.read(tmp_path / "small_pieces.parquet"), whole)


def test_wall_clock_stamps_keep_their_nanoseconds(tmp_path: Path) -> None:
    expected = twin()
    epoch = 1_723_456_789_123_456_789
    read = recordings.read(WRITERS["mcap"](tmp_path, messages(expected, epoch)), TOPICS)
    ticks = np.round(expected.time * 1e9).astype(int)
    assert read.time.tobytes() == ((ticks - ticks[0]) / 1e9).tobytes()
    assert any(f"which is {epoch + ticks[0]} ns" in note for note in read.notes)


def test_describe_reports_topics_and_their_time_offsets(tmp_path: Path) -> None:
    found = recordings.describe(WRITERS["mcap"](tmp_path, messages(twin())), TOPICS)
    by_topic = {topic.topic: topic for topic in found.topics}
    assert by_topic["/ft/raw"].shared == 300 and by_topic["/tracker"].count == 100
    assert by_topic["/joint_states"].clock_offset == pytest.approx(-5e-6, abs=1e-12)
    assert by_topic["/command"].shared == 0 and by_topic["/command"].clock_offset is None
    assert by_topic["/command"].apart == pytest.approx(333_333e-9)
    text = str(found)
    assert "/ft/raw: geometry_msgs/msg/WrenchStamped, 300 samples" in text and "300 at a stamp of /joint_states" in text
    assert "stamps -5e-06 s from the recorder's clock" in text
    assert found.as_dict()["topics"][0]["topic"] == "/joint_states"


def test_join_moves_stamps_only_as_far_as_asked(tmp_path: Path) -> None:
    path = WRITERS["mcap"](tmp_path, messages(twin()))
    near = recordings.read(path, TOPICS | {"/command": Topic(columns=["cmd.a", "", "cmd.b"], join=4e-4)})
    assert len(near) == 300 and not np.isnan(near.columns["cmd.a"]).any()
    assert any("/command: 300 of 300 samples are at a stamp" in note for note in near.notes)
    far = recordings.read(path, TOPICS | {"/command": Topic(columns=["cmd.a", "", "cmd.b"], join=3e-4)})
    assert len(far) == 600


def test_without_topics_names_are_the_file_s_own(tmp_path: Path) -> None:
    read = recordings.read(WRITERS["mcap"](tmp_path, messages(twin())))
    assert read.joints("u") == ("motor_1", "motor_2", "gripper")
    assert read.wrench_sensors == ("ft_raw",) and read.bodies == ("tracker",)
    assert any("/command: std_msgs/msg/Float64MultiArray, 300 messages left alone" in note for note in read.notes)


def test_an_unknown_type_is_listed_and_left_alone(tmp_path: Path) -> None:
    found = messages(twin(20))
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Mcap2Writer(file)
        strange = writer.register_msgdef("lab_msgs/msg/Oven", "float64 heat\n")
        known = writer.register_msgdef(found[0][1], ROS2.generate_msgdef(found[0][1], ros_version=2)[0])
        for topic, kind, stamp, log, holds in found:
            if kind == found[0][1]:
                writer.write_message("/oven", strange, {"heat": 1.0}, log_time=log)
                header = {"stamp": {"sec": 0, "nanosec": stamp}}
                writer.write_message(topic, known, holds | {"header": header}, log_time=log)
        writer.finish()
    description = recordings.describe(path)
    assert [(entry.topic, entry.kind, entry.count) for entry in description.left_alone] == [
        ("/oven", "lab_msgs/msg/Oven", 20)
    ]
    read = recordings.read(path)
    assert "/oven: lab_msgs/msg/Oven, 20 messages left alone (unknown type)" in read.notes and len(read) == 20
    with pytest.raises(InputError, match=r"topics: /oven of type lab_msgs/msg/Oven cannot be read: unknown type"):
        recordings.read(path, {"/oven": Topic()})
    with pytest.raises(InputError, match=r"topics: /absent has no usable message; the file has .*/oven"):
        recordings.read(path, {"/absent": Topic()})


def test_a_folder_that_lost_its_metadata_is_still_read(tmp_path: Path) -> None:
    expected = twin()
    path = WRITERS["rosbags, MCAP"](tmp_path, messages(expected))
    (path / "metadata.yaml").unlink()
    read = recordings.read(path, TOPICS)
    assert_equal_to_the_bit(read, expected)
    assert "no readable metadata.yaml" in read.notes[0]


def test_stamps_that_are_wrong(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"/joint_states: the stamps decrease from 20 to 15 ns at message 3 of 4"):
        recordings.read(joint_bag(tmp_path / "back.mcap", [10, 20, 15, 30], [1, 2, 3, 4]))
    twice = recordings.read(joint_bag(tmp_path / "twice.mcap", [10, 20, 20, 30]))
    assert twice.columns["q.a"].tolist() == [0.0, 1.0, 3.0]
    assert "/joint_states: 1 messages that repeat a stamp, left out" in twice.notes
    zero = recordings.read(joint_bag(tmp_path / "zero.mcap", [0, 0, 0], [10, 20, 30]))
    assert zero.time.tolist() == [1e-8, 2e-8, 3e-8] and "all stamps are zero" in zero.notes[0]
    # Out of order in the file, in order by the recorder's clock.
    shuffled = recordings.read(joint_bag(tmp_path / "shuffled.mcap", [20, 10, 30]))
    assert shuffled.columns["q.a"].tolist() == [1.0, 0.0, 2.0]
    assert list(shuffled.columns) == ["q.a"]


def test_stamp_offset_and_scale(tmp_path: Path) -> None:
    path = joint_bag(tmp_path / "a.mcap", [1000, 2000], [1500, 2500])
    how = Topic(stamp="log", offset=1e-6, scale=2.0, fields={"position": "cmd"}, joints={"a": "b"})
    read = recordings.read(path, {"/joint_states": how})
    assert read.time.tolist() == [2.5e-6, 3.5e-6] and read.columns["cmd.b"].tolist() == [0.0, 2.0]
    with pytest.raises(InputError, match="stamp is 'sensor', expected header or log"):
        recordings.read(path, {"/joint_states": Topic(stamp="sensor")})


def test_two_topics_with_the_same_column_are_refused(tmp_path: Path) -> None:
    holds = {"name": ["a"], "position": [1.0], "velocity": [], "effort": []}
    found = [(topic, "sensor_msgs/msg/JointState", 5, 5, holds) for topic in ("/one", "/two")]
    with pytest.raises(InputError, match=r"column q\.a comes from the topics /one and /two"):
        recordings.read(write_mcap2(tmp_path / "a.mcap", found))


@pytest.mark.parametrize("kind", ["Float32MultiArray", "Float64MultiArray"])
def test_arrays_are_as_exact_as_their_type(tmp_path: Path, kind: str) -> None:
    values = np.random.default_rng(2).standard_normal((20, 2))
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Mcap2Writer(file)
        schema = writer.register_msgdef(f"std_msgs/msg/{kind}", ROS2.generate_msgdef(f"std_msgs/msg/{kind}")[0])
        for i, row in enumerate(values):
            writer.write_message("/torques", schema, {"data": row.tolist()}, log_time=1000 * i)
        writer.finish()
    read = recordings.read(path, {"/torques": Topic(columns=["u.a", "u.b"])})
    expected = values.astype(np.float32 if kind.startswith("Float32") else np.float64)
    assert np.array_equal(read.matrix("u", ["a", "b"]), expected.astype(np.float64))
    with pytest.raises(InputError, match=f"no message of a type that is read.*{kind}"):
        recordings.read(path)


def test_messages_that_contradict_themselves_are_left_out(tmp_path: Path) -> None:
    good = {"name": ["a"], "position": [1.0], "velocity": [], "effort": []}
    bad = good | {"position": [1.0, 2.0]}
    kind = "sensor_msgs/msg/JointState"
    found = [("/joint_states", kind, i, i, bad if i == 2 else good) for i in range(4)]
    read = recordings.read(write_mcap2(tmp_path / "a.mcap", found))
    assert len(read) == 3
    assert "/joint_states: 1 messages left out (position holds 2 numbers for 1 joints)" in read.notes


def test_import_maps_names_and_resamples_where_asked(tmp_path: Path) -> None:
    path = WRITERS["mcap"](tmp_path, messages(twin()))
    (tmp_path / "s.yaml").write_text("model: arm.urdf\ntopics: {/joint_states: {joints: {motor_1: shoulder}}}\n")
    (found,) = import_command([str(path)], tmp_path / "out", scenario=str(tmp_path / "s.yaml"))
    assert "q.shoulder" in found["columns"] and "/ft/raw" in [entry["topic"] for entry in found["left_alone"]]
    assert recordings.read(tmp_path / "out" / "a.parquet").joints() == ("shoulder", "motor_2", "gripper")
    (found,) = import_command([str(path)], tmp_path / "out", period=0.002)
    even = recordings.read(tmp_path / "out" / "a.parquet")
    assert np.ptp(np.diff(even.time)) < 1e-12 and found["median_step"] == pytest.approx(0.002)
    assert any("resampled to a period of 0.002 s on request" in note for note in found["notes"])
    with pytest.raises(InputError, match=r"another file would be written as a\.parquet too"):
        import_command([str(path), "elsewhere/a.csv"], tmp_path / "out")


def test_columns_with_stamps_of_their_own_are_told_of(tmp_path: Path) -> None:
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    run = record(stiff_grease, 1)
    apart = Recording("apart", np.sort(np.concatenate([run.time, run.time[:-1] + 0.001])), {})
    own = np.isin(apart.time, run.time)
    columns = {name: np.full(apart.time.shape, np.nan) for name in run.columns}
    for name, values in columns.items():
        values[~own if name == "u.elbow" else own] = run[name][: (~own).sum() if name == "u.elbow" else None]
    with pytest.raises(InputError, match=r"u\.shoulder and u\.elbow have values together in only 0 of 2001 rows"):
        diagnose(scene, [Recording("apart", apart.time, columns)])
    slow = np.where(np.arange(len(run)) % 5 == 0, run["u.elbow"], np.nan)
    with pytest.raises(InputError, match=r"q\.shoulder and u\.elbow have values together in only 201 of 1001 rows"):
        diagnose(scene, [Recording("slow", run.time, dict(run.columns) | {"u.elbow": slow})])
