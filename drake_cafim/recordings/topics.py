"""Mapping of the names in a foreign file to columns of a recording: the `topics:` section of a scenario.

A key is a topic of a bag, a channel of an LCM log, an array of an .npz file or a column of a .csv file::

    topics:
      /joint_states: {joints: {panda_joint1: j1, panda_finger_joint1: ""}}   # "" leaves a joint out
      /desired: {fields: {position: cmd}}                   # a JointState that holds commanded positions
      /ft_sensor/raw: {sensor: wrist, join: 0.0005}         # WrenchStamped to wrench.wrist.fx and so on
      /optitrack/ball: {body: ball, offset: -0.012}         # PoseStamped to pose.ball.x and so on
      /torques: {columns: [u.j1, u.j2, ""]}                 # Float64MultiArray, element by element
      "Elbow angle [deg]": {columns: [q.elbow], scale: 0.017453292519943295}   # a .csv column
      stamp_ns: {columns: [time], scale: 1.0e-9}
      x: {columns: [q.elbow, v.elbow]}                      # an .npz array (n, N) or (N, n)

With the section, a bag's or a log's other topics are not read; of a table, the other columns keep their
names. Without it every topic of a known type is read: a JointState's joints by their names (as `cmd` on a topic
`.../joint_command` or `.../joint_commands`), a WrenchStamped's sensor, a PoseStamped's body and a Float64's
column by the topic's own name (`/ft/wrist` is `ft_wrist`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from drake_cafim.errors import InputError, check_type
from drake_cafim.numerics.ranges import number
from drake_cafim.recordings.recording import JOINT_KINDS
from drake_cafim.typing import Array

STAMPS = ("header", "log")


@dataclass
class Topic:
    """The columns and units of one topic, array or foreign column; the defaults keep the file's own names."""

    joints: dict[str, str] = field(default_factory=dict)  # the file's joint name to the model's; "": left out
    fields: dict[str, str] = field(default_factory=dict)  # array of the message to q, v, u, cmd; "": left out
    sensor: str = ""  # the sensor that a wrench message belongs to
    body: str = ""  # the body that a pose message belongs to
    columns: list[str] = field(default_factory=list)  # of an array's elements, in their order; "": left out
    scale: float = number(1.0, least=-1e12, most=1e12)  # the file's unit in SI, as 0.017453292519943295 for degrees
    offset: float = number(0.0, "s", least=-4e9, most=4e9)  # added to this topic's stamps
    join: float = number(
        0.0, "s", least=0.0, most=1e6
    )  # a sample at most this far from a stamp of the other topics takes over that stamp
    stamp: str = "header"  # the clock that is used: header (the message's own), or log (the recorder's)


Topics = Mapping[str, Topic]


def check_topics(topics: Topics, source: str) -> None:
    """Raises `InputError` naming the topic, the key and the valid choices; `source` names the scenario."""
    check_type(f"{source}: topics", topics, Mapping, "a Topic by name")
    for name, topic in topics.items():
        check_type(f"{source}: topics: {name}", topic, Topic, "a Topic")
        if topic.stamp not in STAMPS:
            raise InputError(f"{source}: topics: {name}: stamp is {topic.stamp!r}, expected header or log")
        if topic.join < 0.0 or topic.scale == 0.0:
            raise InputError(f"{source}: topics: {name}: join must not be negative, nor scale zero")
        for array, kind in topic.fields.items():
            if kind and kind not in JOINT_KINDS:
                raise InputError(
                    f"{source}: topics: {name}: field {array} is to become {kind!r}, expected one of "
                    f"{', '.join(JOINT_KINDS)} or an empty text"
                )


def own_name(topic: str) -> str:
    """The topic's name without slashes at its ends and with _ for those between its parts: /ft/wrist is ft_wrist."""
    return topic.strip("/").replace("/", "_")


def rename_columns(name: str, table: Mapping[str, Array], topics: Topics) -> dict[str, Array]:
    """The table's columns under the names that `topics` gives them, in SI units.

    Raises `InputError` when `topics` names a column that the table lacks, or gives two columns the same name.
    """
    missing = [column for column in topics if column not in table]
    if missing:
        raise InputError(f"{name}: topics: there is no column {missing[0]}; it has {', '.join(table)}")
    result: dict[str, Array] = {}
    for column, values in table.items():
        how = topics.get(column, Topic())
        new = how.columns[0] if how.columns else column
        if column in topics and how.columns == [""]:
            continue
        if new in result:
            raise InputError(f"{name}: topics: two columns become {new}, {column} is the second")
        result[new] = values if how.scale == 1.0 else values * how.scale
    return result
