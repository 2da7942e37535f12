"""The columns of a recording, as a table."""

from drake_cafim.diagrams.reference.tables import table
from drake_cafim.recordings.recording import JOINT_KINDS, POSE_COMPONENTS, WRENCH_COMPONENTS

JOINTS = {
    "q": ("rad or m", "position of the joint, on the link's side; needed of each joint that moves"),
    "v": ("rad/s or m/s", "its velocity, if it was measured"),
    "u": (
        "N m or N",
        "effort at the joint, gravity not taken out; needed where no servo drives the joint, unless by the model, "
        "which drives others, nothing does. Commanded (`std: 0`) or measured; it is held from its sample to the next, "
        "or linear between them (`hold: first_order`)",
    ),
    "cmd": (
        "rad or m",
        "commanded position of a joint with a position servo (`servo:`), held from its sample to the next; a joint "
        "that has `u`, too, is driven by that, unless `drive: servo` is given",
    ),
}
WRENCH = {
    "fx fy fz": ("N", "what the environment's contact exerts on the sensor's body, in the sensor's frame"),
    "tx ty tz": ("N m", "its moment about the sensor frame's origin"),
}
POSE = {
    "x y z": ("m", "position of the body's origin in the world"),
    "qw qx qy qz": (
        "",
        "its rotation, a unit quaternion. Not needed of a ball tracked at its centre, with its centre of mass there, "
        "nor of a body that touches nothing and is tracked at its centre of mass; needed of every other",
    ),
}


def columns() -> str:
    """A row for each kind of column."""
    rows = [["`time`", "s", "increasing; it need not be uniform"]]
    rows += [[f"`{kind}.<joint>`", *JOINTS[kind]] for kind in JOINT_KINDS]
    for place, parts, known in (
        ("wrench.<sensor>", WRENCH, WRENCH_COMPONENTS),
        ("pose.<body>", POSE, POSE_COMPONENTS),
    ):
        assert " ".join(parts).split() == list(known)
        rows += [[", ".join(f"`{place}.{part}`" for part in names.split()), *words] for names, words in parts.items()]
    return table(["column", "unit", "meaning"], rows)
