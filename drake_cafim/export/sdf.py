"""Values into an SDFormat file."""

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.dynamics.tree import Body
from drake_cafim.export.urdf import MOMENTS
from drake_cafim.export.values import JointValues, Values
from drake_cafim.export.xml_text import Node, XmlText, number, numbers


def write_sdf(file: XmlText, values: Values) -> list[str]:
    """Change the file's elements; returns a sentence for each value that could not be written."""
    lost: list[str] = []
    links = {link.get("name"): link for link in file.root.iter("link")}
    joints = {joint.get("name"): joint for joint in file.root.iter("joint")}
    for name, body in values.bodies.items():
        if name not in links:
            lost.append(f"inertia of {name}: the file has no link of this name")
        elif not _set_inertial(file, links[name], body):
            lost.append(f"inertia of {name}: its inertial pose is relative to another frame")
    for name, item in values.joints.items():
        if name in joints:
            _set_joint(file, joints[name], item)
        else:
            lost.append(f"values of {name}: the file has no joint of this name")
    return lost


def _set_inertial(file: XmlText, link: Node, body: Body) -> bool:
    """Whether the body's inertia could be written."""
    inertial = link.find("inertial")
    if inertial is None:
        moments = "".join(f"<{key}>{number(body.I_BBcm_B[at])}</{key}>" for key, at in MOMENTS.items())
        link.first.append(
            f"<inertial><pose>{numbers((*body.p_BBcm, 0.0, 0.0, 0.0))}</pose><mass>{number(body.mass)}</mass>"
            f"<inertia>{moments}</inertia></inertial>"
        )
        return True
    pose = inertial.find("pose")
    if pose is not None and any(pose.get(name) for name in ("relative_to", "rotation_format", "degrees")):
        return False
    words = file.text_of(pose).split() if pose is not None else []
    angles = words[3:6] if len(words) == 6 else ["0", "0", "0"]
    turn = Rotation.from_euler("xyz", [float(word) for word in angles]).as_matrix()
    moment = np.asarray(turn.T @ body.I_BBcm_B @ turn)
    text = f"{numbers(tuple(body.p_BBcm))} {' '.join(angles)}"
    if pose is not None:
        pose.content = text
    else:
        inertial.first.append(f"<pose>{text}</pose>")
    _set_child(inertial, "mass", body.mass)
    inertia = inertial.find("inertia")
    if inertia is None:
        inertial.last.append(
            "<inertia>" + "".join(f"<{key}>{number(moment[at])}</{key}>" for key, at in MOMENTS.items()) + "</inertia>"
        )
    else:
        for key, at in MOMENTS.items():
            _set_child(inertia, key, float(moment[at]))
    return True


def _set_child(parent: Node, tag: str, value: float) -> None:
    child = parent.find(tag)
    if child is None:
        parent.last.append(f"<{tag}>{number(value)}</{tag}>")
    else:
        child.content = number(value)


def _set_joint(file: XmlText, joint: Node, values: JointValues) -> None:
    stiffness, rest = values.spring or (None, None)
    stated = {
        "damping": values.damping, "friction": values.friction, "spring_reference": rest, "spring_stiffness": stiffness,
    }  # fmt: skip
    given = {key: value for key, value in stated.items() if value is not None}
    axis = joint.find("axis")
    if axis is not None:
        _set_section(axis, "dynamics", given)
        _set_section(axis, "limit", {"effort": values.effort_limit} if values.effort_limit is not None else {})
    if values.rotor_inertia is not None:
        gear = joint.find("drake:gear_ratio")
        ratio = float(file.text_of(gear) or 1.0) if gear is not None else 1.0
        _set_child(joint, "drake:rotor_inertia", values.rotor_inertia / ratio**2)


def _set_section(axis: Node, tag: str, given: dict[str, float]) -> None:
    section = axis.find(tag)
    if given and section is None:
        axis.last.append(
            f"<{tag}>" + "".join(f"<{key}>{number(value)}</{key}>" for key, value in given.items()) + f"</{tag}>"
        )
    elif section is not None:
        for key, value in given.items():
            _set_child(section, key, value)
