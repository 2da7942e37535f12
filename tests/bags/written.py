"""A table, and the bags that public libraries make of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as Mcap2Writer
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from drake_cafim import recordings
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


def joint_bag(path: Path, stamps: list[int], logs: list[int] | None = None) -> Path:
    holds = {"name": ["a"], "velocity": [], "effort": []}
    found = [
        ("/joint_states", "sensor_msgs/msg/JointState", stamp, log, holds | {"position": [float(i)]})
        for i, (stamp, log) in enumerate(zip(stamps, logs or stamps, strict=True))
    ]
    return write_mcap2(path, found)
