"""Bags and logs written with public libraries are read equal to their Parquet twin to the bit."""

import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drake import lcmt_drake_signal, lcmt_force_torque, lcmt_iiwa_status
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as Mcap2Writer
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings import Recording, Topic

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
JOINTS = ["shoulder", "elbow"]
TOPICS = {
    "/joint_states": Topic(joints={"motor_1": "shoulder", "motor_2": "elbow", "gripper": ""}),
    "/ft/raw": Topic(sensor="wrist"),
    "/tracker": Topic(body="ball"),
    "/command": Topic(columns=["cmd.shoulder", "", "cmd.elbow"]),
}
Message = tuple[str, str, int, int, dict[str, Any]]  # topic, type, stamp, log (ns), what it holds


def twin(samples: int = 300) -> Recording:
    """What the bags hold, as a table; the tracker is slower, the command has stamps of its own."""
    rng = np.random.default_rng(11)
    ticks = np.cumsum(rng.integers(900_000, 1_100_000, samples))
    command = ticks + 333_333
    rows = np.sort(np.concatenate([ticks, command]))
    own, theirs = np.isin(rows, ticks), np.isin(rows, command)
    columns: dict[str, np.ndarray] = {}

    def put(name: str, where: np.ndarray) -> None:
        columns[name] = np.where(where, rng.standard_normal(rows.size) * 1e-3, np.nan)

    for kind in ("q", "v", "u"):
        for joint in JOINTS:
            put(f"{kind}.{joint}", own)
    for component in recordings.WRENCH_COMPONENTS:
        put(f"wrench.wrist.{component}", own)
    third = own & np.isin(rows, ticks[::3])
    for component in recordings.POSE_COMPONENTS:
        put(f"pose.ball.{component}", third)
    for joint in JOINTS:
        put(f"cmd.{joint}", theirs)
    return Recording(name="twin", time=rows / 1e9, columns=columns)


def messages(recording: Recording, epoch: int = 0) -> list[Message]:
    """The recording's rows as messages; the recorder stamps a little later than the header."""
    found: list[Message] = []
    c = recording.columns
    for i, tick in enumerate(np.round(recording.time * 1e9).astype(int).tolist()):
        stamp = tick + epoch
        if not np.isnan(c["q.elbow"][i]):
            arrays = [[c[f"{kind}.{joint}"][i] for joint in JOINTS] + [0.5] for kind in ("q", "v", "u")]
            names = ["motor_1", "motor_2", "gripper"]
            joints = dict(zip(("name", "position", "velocity", "effort"), [names, *arrays], strict=True))
            found.append(("/joint_states", "sensor_msgs/msg/JointState", stamp, stamp + 5000, joints))
            f = [c[f"wrench.wrist.{component}"][i] for component in recordings.WRENCH_COMPONENTS]
            wrench = {"force": dict(zip("xyz", f[:3], strict=True)), "torque": dict(zip("xyz", f[3:], strict=True))}
            found.append(("/ft/raw", "geometry_msgs/msg/WrenchStamped", stamp, stamp + 9000, {"wrench": wrench}))
        if not np.isnan(c["pose.ball.x"][i]):
            x = [c[f"pose.ball.{component}"][i] for component in recordings.POSE_COMPONENTS]
            pose = {
                "position": dict(zip("xyz", x[:3], strict=True)),
                "orientation": dict(zip("wxyz", x[3:], strict=True)),
            }
            found.append(("/tracker", "geometry_msgs/msg/PoseStamped", stamp, stamp + 9500, {"pose": pose}))
        if not np.isnan(c["cmd.elbow"][i]):
            data = [c["cmd.shoulder"][i], 7.0, c["cmd.elbow"][i]]
            found.append(("/command", "std_msgs/msg/Float64MultiArray", stamp, stamp, {"data": data}))
    return found


def built(store: Any, kind: str, stamp: int, holds: dict[str, Any]) -> Any:
    """The message as the typestore's class."""
    types = store.types
    if kind.endswith("Float64MultiArray"):
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return types[kind](layout=layout, data=np.array(holds["data"]))
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    sequence = {"seq": 0} if store is ROS1 else {}
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="f", **sequence)
    if kind.endswith("JointState"):
        arrays = {key: np.array(holds[key]) for key in ("position", "velocity", "effort")}
        return types[kind](header=header, name=holds["name"], **arrays)
    vector, geometry = types["geometry_msgs/msg/Vector3"], "geometry_msgs/msg/"
    if kind.endswith("WrenchStamped"):
        wrench = {key: vector(**holds["wrench"][key]) for key in ("force", "torque")}
        return types[kind](header=header, wrench=types[geometry + "Wrench"](**wrench))
    position = types[geometry + "Point"](**holds["pose"]["position"])
    orientation = types[geometry + "Quaternion"](**holds["pose"]["orientation"])
    return types[kind](header=header, pose=types[geometry + "Pose"](position=position, orientation=orientation))


def write_rosbag2(path: Path, found: list[Message], storage: StoragePlugin, compressed: bool = False) -> Path:
    writer = Bag2Writer(path, version=9, storage_plugin=storage)
    if compressed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, log, holds in found:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], log, ROS2.serialize_cdr(built(ROS2, kind, stamp, holds), kind))
    return path


def write_rosbag1(path: Path, found: list[Message]) -> Path:
    with Bag1Writer(path) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, log, holds in found:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], log, ROS1.serialize_ros1(built(ROS1, kind, stamp, holds), kind))
    return path


def write_mcap2(path: Path, found: list[Message], chunk: int = 4096, compression: Any = None) -> Path:
    with path.open("wb") as file:
        writer = Mcap2Writer(file, chunk_size=chunk, compression=compression or CompressionType.ZSTD)
        schemas: dict[str, Any] = {}
        for topic, kind, stamp, log, holds in found:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, ROS2.generate_msgdef(kind, ros_version=2)[0])
            if not kind.endswith("Float64MultiArray"):
                holds = holds | {"header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}}
            writer.write_message(topic, schemas[kind], holds, log_time=log)
        writer.finish()
    return path


WRITERS: dict[str, Callable[[Path, list[Message]], Path]] = {
    "rosbags, MCAP": lambda path, found: write_rosbag2(path / "bag", found, StoragePlugin.MCAP),
    "rosbags, SQLite": lambda path, found: write_rosbag2(path / "bag", found, StoragePlugin.SQLITE3),
    "rosbags, compressed": lambda path, found: write_rosbag2(path / "bag", found, StoragePlugin.SQLITE3, True),
    "rosbags, ROS 1": lambda path, found: write_rosbag1(path / "a.bag", found),
    "mcap": lambda path, found: write_mcap2(path / "a.mcap", found),
    "mcap, lz4": lambda path, found: write_mcap2(path / "a.mcap", found, compression=CompressionType.LZ4),
}


def assert_equal_to_the_bit(read: Recording, expected: Recording) -> None:
    assert read.time.tobytes() == expected.time.tobytes()
    assert sorted(read.columns) == sorted(expected.columns)
    for column, values in expected.columns.items():
        there = ~np.isnan(values)
        assert np.array_equal(there, ~np.isnan(read.columns[column])), column
        assert read.columns[column][there].tobytes() == values[there].tobytes(), column


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
    assert found.notes == whole.notes and found.samples == len(whole)
    monkeypatch.setattr("drake_cafim.recordings.joined.BLOCK_ROWS", 7)
    monkeypatch.setattr("drake_cafim.recordings.joined.Joined.blocks.__defaults__", (7,))
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
    assert any("/command: 300 of 300 samples stand at a stamp" in note for note in near.notes)
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
    assert [(one.topic, one.kind, one.count) for one in description.left_alone] == [("/oven", "lab_msgs/msg/Oven", 20)]
    read = recordings.read(path)
    assert "/oven: lab_msgs/msg/Oven, 20 messages left alone (unknown type)" in read.notes and len(read) == 20
    with pytest.raises(InputError, match=r"topics: /oven of type lab_msgs/msg/Oven cannot be read: unknown type"):
        recordings.read(path, {"/oven": Topic()})
    with pytest.raises(InputError, match=r"topics: /absent has no usable message; the file has .*/oven"):
        recordings.read(path, {"/absent": Topic()})


@pytest.mark.parametrize("writer", ["rosbags, MCAP", "rosbags, SQLite", "rosbags, ROS 1", "mcap"])
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.95])
def test_a_bag_cut_in_the_middle(tmp_path: Path, writer: str, kept: float) -> None:
    expected = twin(2000)
    path = WRITERS[writer](tmp_path, messages(expected))
    file = next(one for one in path.iterdir() if one.suffix in (".mcap", ".db3")) if path.is_dir() else path
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


def test_a_folder_that_lost_its_metadata_is_still_read(tmp_path: Path) -> None:
    expected = twin()
    path = WRITERS["rosbags, MCAP"](tmp_path, messages(expected))
    (path / "metadata.yaml").unlink()
    read = recordings.read(path, TOPICS)
    assert_equal_to_the_bit(read, expected)
    assert "no readable metadata.yaml" in read.notes[0]


def test_files_that_are_no_bag(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.db3", "a.bag", "a.lcm"):
        (tmp_path / name).write_bytes(b"this is a letter to my aunt, of some length " * 40)
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            recordings.read(tmp_path / name)
    sqlite3.connect(tmp_path / "empty.db3").execute("CREATE TABLE x (y)").connection.close()
    with pytest.raises(InputError, match="not a whole ROS 2 bag"):
        recordings.read(tmp_path / "empty.db3")


def joint_bag(path: Path, stamps: list[int], logs: list[int] | None = None) -> Path:
    holds = {"name": ["a"], "velocity": [], "effort": []}
    found = [
        ("/joint_states", "sensor_msgs/msg/JointState", stamp, log, holds | {"position": [float(i)]})
        for i, (stamp, log) in enumerate(zip(stamps, logs or stamps, strict=True))
    ]
    return write_mcap2(path, found)


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


def test_messages_that_contradict_themselves_are_left_out(tmp_path: Path) -> None:
    good = {"name": ["a"], "position": [1.0], "velocity": [], "effort": []}
    bad = good | {"position": [1.0, 2.0]}
    kind = "sensor_msgs/msg/JointState"
    found = [("/joint_states", kind, i, i, bad if i == 2 else good) for i in range(4)]
    read = recordings.read(write_mcap2(tmp_path / "a.mcap", found))
    assert len(read) == 3
    assert "/joint_states: 1 messages left out (position holds 2 numbers for 1 joints)" in read.notes


def test_out_as_mcap_and_back_with_residuals(tmp_path: Path) -> None:
    given = twin(50)
    columns = dict(given.columns) | {"u_cmd.elbow": given.time}
    given = Recording(name="a", time=given.time, columns=columns)
    recordings.write(given, tmp_path / "a.mcap")
    assert_equal_to_the_bit(recordings.read(tmp_path / "a.mcap"), given)
    first = (tmp_path / "a.mcap").read_bytes()
    assert recordings.write(given, tmp_path / "b.mcap").read_bytes() == first
    residuals = {"q.elbow": np.where(np.isnan(given.columns["q.elbow"]), np.nan, 0.25)}
    recordings.write_mcap(given, tmp_path / "c.mcap", residuals)
    back = recordings.read(tmp_path / "c.mcap")
    assert np.nansum(back.columns["residual_q.elbow"]) == 0.25 * 50
    with pytest.raises(InputError, match=r"residual q\.elbow has shape"):
        recordings.write_mcap(given, tmp_path / "c.mcap", {"q.elbow": np.zeros(3)})


def test_a_public_reader_opens_what_is_written(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    given = twin(20)
    recordings.write(given, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    q = [message.position[1] for topic, message in decoded if topic == "/joint_states"]
    expected = given.columns["q.elbow"]
    assert q == expected[~np.isnan(expected)].tolist()
    w = [message.pose.orientation.w for topic, message in decoded if topic == "/ball"]
    assert w == given.columns["pose.ball.qw"][~np.isnan(given.columns["pose.ball.qw"])].tolist()


def lcm_event(number: int, microseconds: int, channel: bytes, data: bytes) -> bytes:
    head = b"\xed\xa1\xda\x01" + number.to_bytes(8, "big") + microseconds.to_bytes(8, "big")
    return head + len(channel).to_bytes(4, "big") + len(data).to_bytes(4, "big") + channel + data


def write_lcm(path: Path, samples: int = 5) -> Path:
    events = []
    for i in range(samples):
        status = lcmt_iiwa_status()
        status.utime, status.num_joints = 1000 * i, 2
        for name in status.__slots__[2:]:
            setattr(status, name, [float(i), -float(i)])
        force = lcmt_force_torque()
        force.timestamp, force.fz = i, 9.0 + i
        signal = lcmt_drake_signal()
        signal.dim, signal.val, signal.coord, signal.timestamp = 2, [0.5, 0.25], ["u.a", "speed"], i
        sent = {b"IIWA_STATUS": status, b"FT": force, b"SIGNAL": signal}
        events += [(i * 1000 + 10, channel, message.encode()) for channel, message in sent.items()]
        events.append((i * 1000 + 20, b"OTHER", b"12345678 not Drake's"))
    path.write_bytes(b"".join(lcm_event(n, *event) for n, event in enumerate(events)))
    return path


def test_lcm_log_of_drake_types(tmp_path: Path) -> None:
    path = write_lcm(tmp_path / "a.lcm")
    read = recordings.read(path)
    assert read.time.tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]
    assert read.columns["q.iiwa_joint_2"].tolist() == [0.0, -1.0, -2.0, -3.0, -4.0]
    assert read.wrench("FT")[:, 2].tolist() == [9.0, 10.0, 11.0, 12.0, 13.0]
    assert read.columns["u.a"].tolist() == [0.5] * 5 and read.other_columns == ("speed",)
    assert any(note.startswith("OTHER: ") and "left alone (unknown type)" in note for note in read.notes)
    path.write_bytes(path.read_bytes()[:-300])
    assert any("the log is cut at byte" in note for note in recordings.read(path).notes)


BIG = """
import sys
from pathlib import Path
from drake_cafim import recordings
print(recordings.convert(sys.argv[1], sys.argv[2]).samples)
# ru_maxrss would begin with the memory of the process that forked this one
print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
"""


def convert_apart(path: Path, out: Path) -> tuple[int, float]:
    """Samples and peak memory (MiB) of a conversion in a process of its own."""
    done = subprocess.run([sys.executable, "-c", BIG, path, out], capture_output=True, text=True, check=True)
    samples, peak = done.stdout.split()
    return int(samples), int(peak) / 1024.0


def write_big(path: Path, joint_states: int, ballast: int) -> None:
    """Joint states of seven joints with `ballast` bytes of a camera's messages beside each hundredth."""
    from mcap.writer import Writer

    names = [f"panda_joint{i + 1}" for i in range(7)]
    kind = "sensor_msgs/msg/JointState"
    holds = {"name": names, "position": [0.1] * 7, "velocity": [0.2] * 7, "effort": [0.3] * 7}
    template = bytearray(ROS2.serialize_cdr(built(ROS2, kind, 0, holds), kind))
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", ROS2.generate_msgdef(kind, ros_version=2)[0].encode())
        joints = writer.register_channel("/joint_states", "cdr", schema)
        camera = writer.register_channel("/camera", "cdr", writer.register_schema("a_msgs/msg/B", "ros2msg", b""))
        picture = bytes(ballast)
        for i in range(joint_states):
            stamp = 1_000_000 * (i + 1)
            template[4:12] = (stamp // 10**9).to_bytes(4, "little") + (stamp % 10**9).to_bytes(4, "little")
            writer.add_message(joints, stamp, bytes(template), stamp)
            if ballast and i % 100 == 0:
                writer.add_message(camera, stamp, picture, stamp)
        writer.finish()


def test_a_long_bag_is_streamed(tmp_path: Path) -> None:
    write_big(tmp_path / "a.mcap", 20_000, 500_000)  # 100 MB of pictures
    samples, peak = convert_apart(tmp_path / "a.mcap", tmp_path / "a.parquet")
    assert samples == 20_000 and peak < 450


@pytest.mark.long
@pytest.mark.parametrize(("joint_states", "ballast"), [(200_000, 1_000_000), (5_500_000, 0)])
def test_two_gibibytes_within_one_of_memory(tmp_path: Path, joint_states: int, ballast: int) -> None:
    write_big(tmp_path / "a.mcap", joint_states, ballast)
    assert (tmp_path / "a.mcap").stat().st_size > 1.9 * 2**30
    samples, peak = convert_apart(tmp_path / "a.mcap", tmp_path / "a.parquet")
    assert samples == joint_states and peak < 1024
