"""Writing of a recording as MCAP with ROS 2 messages, which Foxglove and PlotJuggler open.

Joints go to /joint_states and /joint_commands (JointState), each wrench sensor and body to a topic of its name
(WrenchStamped, PoseStamped), every other column and every residual to a Float64 topic of its name. Stamps are
whole nanoseconds, the recorder's the same as the messages'. Reading the file gives the same columns again.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS, Recording
from drake_cafim.typing import Array

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POSE = "geometry_msgs/msg/PoseStamped"
FLOAT = "std_msgs/msg/Float64"

Message = tuple[str, str, Any]  # topic, type, message


def write_mcap(recording: Recording, path: Path, residuals: Mapping[str, Array] | None = None) -> None:
    """Write the recording, and each of `residuals` ((N,) at the recording's stamps) as /residual/<channel>.

    A message without any measurement is not written; a missing one beside others is NaN. The same data gives the
    same bytes. Raises `InputError` for negative time, which a ROS stamp cannot hold, and residuals of another length.
    """
    if len(recording) and recording.time[0] < 0.0:
        raise InputError(f"{recording.name}: time begins at {recording.time[0]} s, MCAP cannot hold negative stamps")
    for channel, values in (residuals or {}).items():
        if np.shape(values) != recording.time.shape:
            raise InputError(
                f"{recording.name}: residual {channel} has shape {np.shape(values)}, expected {recording.time.shape}"
            )
    store = get_typestore(Stores.ROS2_HUMBLE)
    stamps = np.round(recording.time * 1e9).astype(np.int64)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="drake_cafim")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for i, stamp in enumerate(stamps.tolist()):
            for topic, kind, message in _messages(store, recording, residuals or {}, i, stamp):
                if kind not in schemas:
                    definition, _ = store.generate_msgdef(kind, ros_version=2)
                    schemas[kind] = writer.register_schema(kind, "ros2msg", definition.encode())
                if topic not in channels:
                    channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
                data = bytes(store.serialize_cdr(message, kind))
                writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=data)
        writer.finish()


def _messages(
    store: Any, recording: Recording, residuals: Mapping[str, Array], i: int, stamp: int
) -> Iterator[Message]:
    """The messages of sample i."""
    types = store.types
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)

    def header(frame: str) -> Any:
        return types["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    yield from _joints(types, header(""), recording, i)
    for sensor in recording.wrench_sensors:
        f = _row(recording, f"wrench.{sensor}", WRENCH_COMPONENTS, i)
        if not np.isnan(f).all():
            vector = types["geometry_msgs/msg/Vector3"]
            wrench = types["geometry_msgs/msg/Wrench"](force=vector(*f[:3]), torque=vector(*f[3:]))
            yield f"/{sensor}", WRENCH, types[WRENCH](header=header(sensor), wrench=wrench)
    for body in recording.bodies:
        x = _row(recording, f"pose.{body}", POSE_COMPONENTS, i)
        if not np.isnan(x).all():
            position = types["geometry_msgs/msg/Point"](*x[:3])
            orientation = types["geometry_msgs/msg/Quaternion"](x=x[4], y=x[5], z=x[6], w=x[3])
            pose = types["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
            yield f"/{body}", POSE, types[POSE](header=header("world"), pose=pose)
    numbers = {column: recording.columns[column] for column in recording.other_columns}
    numbers |= {f"residual/{channel}": values for channel, values in residuals.items()}
    for name, values in numbers.items():
        if not np.isnan(values[i]):
            yield f"/{name}", FLOAT, types[FLOAT](data=float(values[i]))


def _joints(types: Any, header: Any, recording: Recording, i: int) -> Iterator[Message]:
    """One JointState of all joints with q, v, u, and one of commanded positions."""
    names = list(dict.fromkeys(name for kind in ("q", "v", "u") for name in recording.joints(kind)))
    rows = [_row(recording, kind, names, i) for kind in ("q", "v", "u")]
    arrays = [np.empty(0) if np.isnan(row).all() else row for row in rows]
    if any(array.size for array in arrays):
        position, velocity, effort = arrays
        yield (
            "/joint_states",
            JOINT_STATE,
            types[JOINT_STATE](header=header, name=names, position=position, velocity=velocity, effort=effort),
        )
    commanded = list(recording.joints("cmd"))
    values = _row(recording, "cmd", commanded, i)
    if not np.isnan(values).all():
        none = np.empty(0)
        yield (
            "/joint_commands",
            JOINT_STATE,
            types[JOINT_STATE](header=header, name=commanded, position=values, velocity=none, effort=none),
        )


def _row(recording: Recording, kind: str, names: list[str] | tuple[str, ...], i: int) -> Array:
    """Sample i of `<kind>.<name>` (len(names),), NaN where there is no such column."""
    columns = (recording.columns.get(f"{kind}.{name}") for name in names)
    return np.array([np.nan if column is None else column[i] for column in columns], dtype=np.float64)
