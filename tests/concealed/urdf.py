"""The nominal model file that the diagnosis gets."""

from __future__ import annotations

import numpy as np

from .robots import Array, Joint, Link, Robot


def _vector(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def link_xml(link: Link, extra: str = "") -> str:
    """A URDF link with its inertial."""
    i = link.inertia
    return (
        f'  <link name="{link.name}">\n'
        f'    <inertial><origin xyz="{_vector(link.com)}"/><mass value="{link.mass!r}"/>'
        f'<inertia ixx="{float(i[0, 0])!r}" iyy="{float(i[1, 1])!r}" izz="{float(i[2, 2])!r}" '
        f'ixy="{float(i[0, 1])!r}" ixz="{float(i[0, 2])!r}" iyz="{float(i[1, 2])!r}"/></inertial>\n{extra}  </link>\n'
    )


def _joint_xml(joint: Joint, parent: str, child: str) -> str:
    reach = 100.0 if joint.kind == "revolute" else 10.0
    return (
        f'  <joint name="{joint.name}" type="{joint.kind}">\n'
        f'    <parent link="{parent}"/><child link="{child}"/>\n'
        f'    <origin xyz="{_vector(joint.origin)}" rpy="{_vector(joint.rpy)}"/><axis xyz="{_vector(joint.axis)}"/>\n'
        f'    <limit lower="-{reach}" upper="{reach}" effort="10000" velocity="500"/>'
        f'<dynamics damping="{joint.damping!r}"/>\n  </joint>\n'
        f'  <transmission name="{joint.name}_drive">\n    <type>transmission_interface/SimpleTransmission</type>\n'
        f'    <joint name="{joint.name}"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>\n'
        f'    <actuator name="{joint.name}"><drake:rotor_inertia value="{joint.rotor_inertia!r}"/>'
        f'<drake:gear_ratio value="1"/></actuator>\n  </transmission>\n'
    )


def arm_urdf(robot: Robot, extra_link: dict[str, str] | None = None, tail: str = "") -> str:
    """The robot as URDF; `extra_link` adds elements to named links, `tail` elements to the robot."""
    extra = extra_link or {}
    lines = [
        f'<?xml version="1.0"?>\n<robot name="{robot.name}" xmlns:drake="http://drake.mit.edu">\n'
        '  <link name="base"/>\n'
    ]
    lines += [link_xml(link, extra.get(link.name, "")) for link in robot.links]
    for index, joint in enumerate(robot.joints):
        parent = "base" if joint.parent < 0 else robot.links[joint.parent].name
        lines.append(_joint_xml(joint, parent, robot.links[index].name))
    return "".join(lines) + tail + "</robot>\n"


def free_body_urdf(link: Link, geometry: str) -> str:
    """A single free body whose collision geometry is `geometry` (URDF), at its frame's origin."""
    collision = f'    <collision name="shape"><geometry>{geometry}</geometry></collision>\n'
    return (
        f'<?xml version="1.0"?>\n<robot name="{link.name}" xmlns:drake="http://drake.mit.edu">\n'
        + link_xml(link, collision)
        + "</robot>\n"
    )


def sphere(radius: float) -> str:
    return f'<sphere radius="{radius!r}"/>'


def box(extents: Array) -> str:
    return f'<box size="{_vector(np.asarray(extents))}"/>'
