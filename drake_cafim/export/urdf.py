"""Values into a URDF."""

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.dynamics.tree import Body
from drake_cafim.export.values import JointValues, Values
from drake_cafim.export.xml_text import Node, XmlText, number, numbers
from drake_cafim.typing import Array

MOMENTS = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def write_urdf(file: XmlText, values: Values) -> list[str]:
    """Change the file's elements; returns a sentence for each value that could not be written."""
    lost: list[str] = []
    links = {link.get("name"): link for link in file.root.findall("link")}
    joints = {joint.get("name"): joint for joint in file.root.findall("joint")}
    for name, body in values.bodies.items():
        if name in links:
            _set_inertial(links[name], body)
        else:
            lost.append(f"inertia of {name}: the file has no link of this name")
    for name, item in values.joints.items():
        if name in joints:
            _set_joint(file, joints[name], item)
        else:
            lost.append(f"values of {name}: the file has no joint of this name")
    return lost


def _set_inertial(link: Node, body: Body) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        moments = " ".join(f'{key}="{number(body.I_BBcm_B[at])}"' for key, at in MOMENTS.items())
        link.first.append(
            f'<inertial><origin xyz="{numbers(tuple(body.p_BBcm))}"/><mass value="{number(body.mass)}"/>'
            f"<inertia {moments}/></inertial>"
        )
        return
    origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    turn = np.eye(3)
    if origin is not None and origin.get("rpy"):
        turn = Rotation.from_euler("xyz", [float(word) for word in origin.get("rpy").split()]).as_matrix()
    moment: Array = turn.T @ body.I_BBcm_B @ turn
    if origin is not None:
        origin.set("xyz", numbers(tuple(body.p_BBcm)))
    else:
        inertial.first.append(f'<origin xyz="{numbers(tuple(body.p_BBcm))}"/>')
    if mass is not None:
        mass.set("value", number(body.mass))
    else:
        inertial.last.append(f'<mass value="{number(body.mass)}"/>')
    if inertia is not None:
        for key, at in MOMENTS.items():
            inertia.set(key, number(moment[at]))
    else:
        text = " ".join(f'{key}="{number(moment[at])}"' for key, at in MOMENTS.items())
        inertial.last.append(f"<inertia {text}/>")


def _set_joint(file: XmlText, joint: Node, values: JointValues) -> None:
    stated = {"damping": values.damping, "friction": values.friction}
    given = {key: value for key, value in stated.items() if value is not None}
    dynamics = joint.find("dynamics")
    if given and dynamics is None:
        joint.last.append("<dynamics " + " ".join(f'{key}="{number(value)}"' for key, value in given.items()) + "/>")
    elif dynamics is not None:
        for key, value in given.items():
            dynamics.set(key, number(value))
    if values.effort_limit is not None:
        limit = joint.find("limit")
        if limit is None:
            joint.last.append(f'<limit effort="{number(values.effort_limit)}" velocity="1000"/>')
        else:
            limit.set("effort", number(values.effort_limit))
    if values.rotor_inertia is not None:
        _set_rotor(file, joint.get("name"), values.rotor_inertia)


def _set_rotor(file: XmlText, joint: str, inertia: float) -> None:
    """The reflected inertia, kg m², of the joint's actuator: rotor inertia times gear ratio squared, Drake's tags."""
    if "xmlns:drake" not in file.root.attributes:
        file.root.set("xmlns:drake", "http://drake.mit.edu")
    for transmission in file.root.findall("transmission"):
        actuator = transmission.find("actuator")
        if actuator is None or joint not in [item.get("name") for item in transmission.findall("joint")]:
            continue
        ratio, rotor = actuator.find("drake:gear_ratio"), actuator.find("drake:rotor_inertia")
        gear = float(ratio.get("value", "1")) if ratio is not None else 1.0
        if rotor is not None:
            rotor.set("value", number(inertia / gear**2))
        else:
            actuator.last.append(f'<drake:rotor_inertia value="{number(inertia / gear**2)}"/>')
        return
    file.root.last.append(
        f'<transmission name="{joint}_rotor"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{joint}"><hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface></joint>'
        f'<actuator name="{joint}_rotor"><drake:rotor_inertia value="{number(inertia)}"/></actuator></transmission>'
    )
