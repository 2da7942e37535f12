"""Decoding of a message into column names and numbers: ROS types and Drake's LCM types."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS
from drake_cafim.recordings.topics import Topic, own_name
from drake_cafim.typing import Array


class Raw(NamedTuple):
    """One encoded message of a file."""

    topic: str
    kind: str  # the message's type, as sensor_msgs/msg/JointState or lcmt_force_torque
    encoding: str  # cdr, ros1, lcm; any other cannot be decoded
    log: int  # ns, the recorder's clock
    data: bytes


class Sample(NamedTuple):
    """One decoded message: its numbers and their column names in a recording."""

    stamp: int | None  # ns, the message's own stamp; None where its type has none
    columns: tuple[str, ...]
    values: Array  # (len(columns),)


class MalformedError(ValueError):
    """An inconsistent message, as with names and positions of different lengths."""


Decode = Callable[[Any, str, Topic], Sample]

JOINT_STATE = {"position": "q", "velocity": "v", "effort": "u"}
JOINT_COMMAND = {"position": "cmd"}
COMMANDS = ("joint_command", "joint_commands")  # last parts of topics whose positions are commanded
IIWA = {"joint_position_measured": "q", "joint_velocity_estimated": "v", "joint_torque_measured": "u"}
PANDA = {"joint_position": "q", "joint_velocity": "v", "joint_torque": "u"}


def joint_state(message: Any, topic: str, how: Topic) -> Sample:
    """sensor_msgs/JointState: q, v, u of each joint that the message names; cmd where the topic's name says so."""
    commands = topic.rpartition("/")[2] in COMMANDS
    return _joints(message, message.name, JOINT_COMMAND if commands else JOINT_STATE, how, _stamp(message))


def wrench_stamped(message: Any, topic: str, how: Topic) -> Sample:
    """geometry_msgs/WrenchStamped: force and torque, assumed to be about the sensor frame's origin and in its axes."""
    force, torque = message.wrench.force, message.wrench.torque
    values = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    return _sample(_stamp(message), "wrench", how.sensor or own_name(topic), WRENCH_COMPONENTS, values, how)


def pose_stamped(message: Any, topic: str, how: Topic) -> Sample:
    """geometry_msgs/PoseStamped: X_WB; its frame is assumed to be the world. ROS stores a quaternion's w last."""
    p, q = message.pose.position, message.pose.orientation
    values = [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
    sample = _sample(_stamp(message), "pose", how.body or own_name(topic), POSE_COMPONENTS, values, Topic())
    sample.values[:3] *= how.scale  # a scale is of lengths; a quaternion has none
    return sample


def float64_multi_array(message: Any, topic: str, how: Topic) -> Sample:
    """std_msgs/Float64MultiArray and Float32MultiArray: one element for each of `columns:`; the recorder's stamp."""
    return _elements(message.data, None, how)


def float64(message: Any, topic: str, how: Topic) -> Sample:
    """std_msgs/Float64 and Float32: one column, by default of the topic's name; the recorder's stamp."""
    column = how.columns[0] if how.columns else own_name(topic)
    return Sample(None, (column,), np.array([message.data]) * how.scale)


def iiwa_status(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_iiwa_status: q, v, u of joints with the names of Drake's iiwa model."""
    names = [f"iiwa_joint_{i + 1}" for i in range(message.num_joints)]
    return _joints(message, names, IIWA, how, message.utime * 1000)


def panda_status(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_panda_status: q, v, u of joints with the names of Drake's Panda model."""
    names = [f"panda_joint{i + 1}" for i in range(message.num_joints)]
    return _joints(message, names, PANDA, how, message.utime * 1000)


def robot_state(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_robot_state: positions (float32) of the joints that it names."""
    return _joints(message, message.joint_name, {"joint_position": "q"}, how, message.utime * 1000)


def force_torque(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_force_torque: the wrench of a sensor; its stamp is in milliseconds."""
    values = [getattr(message, component) for component in WRENCH_COMPONENTS]
    sensor = how.sensor or own_name(topic)
    return _sample(message.timestamp * 1_000_000, "wrench", sensor, WRENCH_COMPONENTS, values, how)


def drake_signal(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_drake_signal: a vector; its columns are the names of its coordinates unless `columns:` gives others."""
    named = how if how.columns else Topic(columns=list(message.coord), scale=how.scale)
    return _elements(message.val, message.timestamp * 1_000_000, named)


def scope(message: Any, topic: str, how: Topic) -> Sample:
    """lcmt_scope: a vector with one element for each of `columns:`."""
    return _elements(message.value, message.utime * 1000, how)


DECODERS: Mapping[str, Decode] = {
    "sensor_msgs/msg/JointState": joint_state,
    "geometry_msgs/msg/WrenchStamped": wrench_stamped,
    "geometry_msgs/msg/PoseStamped": pose_stamped,
    "std_msgs/msg/Float64MultiArray": float64_multi_array,
    "std_msgs/msg/Float64": float64,
    "std_msgs/msg/Float32MultiArray": float64_multi_array,
    "std_msgs/msg/Float32": float64,
    "lcmt_iiwa_status": iiwa_status,
    "lcmt_panda_status": panda_status,
    "lcmt_robot_state": robot_state,
    "lcmt_force_torque": force_torque,
    "lcmt_drake_signal": drake_signal,
    "lcmt_scope": scope,
}
NEED_COLUMNS = (
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/Float32MultiArray",
    "lcmt_scope",
)  # they do not say what their elements are


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _joints(message: Any, names: Sequence[str], default: dict[str, str], how: Topic, stamp: int) -> Sample:
    """The message's arrays as columns of the joints `names`; an empty array was not measured and has no columns."""
    columns: list[str] = []
    parts: list[Array] = []
    for array, kind in (default | how.fields).items():
        values = np.asarray(getattr(message, array, ()), dtype=np.float64)
        if not kind or values.size == 0:
            continue
        if values.size != len(names):
            raise MalformedError(f"{array} holds {values.size} numbers for {len(names)} joints")
        renamed = [how.joints.get(name, name) for name in names]
        keep = [i for i, name in enumerate(renamed) if name]
        columns += [f"{kind}.{renamed[i]}" for i in keep]
        parts.append(values[keep])
    values = np.concatenate(parts) if parts else np.empty(0)
    return Sample(stamp, tuple(columns), values if how.scale == 1.0 else values * how.scale)


def _sample(stamp: int, kind: str, place: str, components: tuple[str, ...], values: list[float], how: Topic) -> Sample:
    columns = tuple(f"{kind}.{place}.{component}" for component in components)
    return Sample(stamp, columns, np.array(values, dtype=np.float64) * how.scale)


def _elements(data: Sequence[float], stamp: int | None, how: Topic) -> Sample:
    values = np.asarray(data, dtype=np.float64)
    if values.size != len(how.columns):
        raise MalformedError(f"it holds {values.size} numbers, columns: names {len(how.columns)}")
    keep = [i for i, column in enumerate(how.columns) if column]
    return Sample(stamp, tuple(how.columns[i] for i in keep), values[keep] * how.scale)
