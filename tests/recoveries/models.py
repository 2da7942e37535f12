"""Robots of the corrected plant's tests, and their scenes: an arm of three joints, a tool on a stage before a wall."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from drake_cafim.scene.scene import Scene

LINK = """<link name="{name}"><inertial><origin xyz="{x} 0.01 -0.02"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{origin}"/><axis xyz="{axis}"/><limit lower="-9" upper="9" effort="900" velocity="90"/>
<dynamics damping="0.1"/></joint>
<transmission name="{name}_t"><type>transmission_interface/SimpleTransmission</type><joint name="{name}">
<hardwareInterface>EffortJointInterface</hardwareInterface></joint><actuator name="{name}">
<drake:rotor_inertia value="0.04"/><drake:gear_ratio value="1"/></actuator></transmission>"""
ARM = (
    '<robot name="arm" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + "".join(LINK.format(name=n, x=x, mass=m) for n, x, m in (("l1", 0.0, 2.0), ("l2", 0.2, 1.5), ("l3", 0.15, 1.0)))
    + "".join(
        JOINT.format(name=n, parent=p, child=c, origin=o, axis=a)
        for n, p, c, o, a in (
            ("turn", "base", "l1", "0 0 0.3", "0 0 1"),
            ("lift", "l1", "l2", "0.05 0 0.1", "0 1 0"),
            ("elbow", "l2", "l3", "0.4 0 0", "0 1 0"),
        )
    )
    + "</robot>"
)
STAGE_LINK = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>"""
STAGE_JOINT = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="900" velocity="90"/></joint>"""
BALL = """<collision name="ball"><geometry><sphere radius="0.02"/></geometry><drake:proximity_properties>
<drake:compliant_hydroelastic/><drake:hydroelastic_modulus value="1e7"/><drake:mesh_resolution_hint value="0.005"/>
<drake:mu_dynamic value="0.4"/></drake:proximity_properties></collision>"""
WALL = """<collision name="wall"><origin xyz="0 0 -0.05"/><geometry><box size="1 1 0.1"/></geometry>
<drake:proximity_properties><drake:rigid_hydroelastic/><drake:mesh_resolution_hint value="1"/>
<drake:mu_dynamic value="0.4"/></drake:proximity_properties></collision>"""
STAGE = (
    '<robot name="stage" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + STAGE_LINK.format(name="wall", mass=1.0, more=WALL)
    + "".join(
        STAGE_LINK.format(name=n, mass=m, more=more)
        for n, m, more in (("bridge", 2.0, ""), ("carriage", 1.0, ""), ("tool", 0.8, BALL))
    )
    + "".join(
        STAGE_JOINT.format(name=n, parent=p, child=c, axis=a)
        for n, p, c, a in (
            ("x", "base", "bridge", "1 0 0"),
            ("y", "bridge", "carriage", "0 1 0"),
            ("z", "carriage", "tool", "0 0 1"),
        )
    )
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint></robot>'
)
ROLLER = (
    '<robot name="roller" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + STAGE_LINK.format(name="wall", mass=1.0, more=WALL)
    + "".join(
        STAGE_LINK.format(name=n, mass=m, more=more)
        for n, m, more in (("bridge", 2.0, ""), ("lifter", 1.0, ""), ("tool", 0.8, BALL))
    )
    + "".join(
        STAGE_JOINT.format(name=n, parent=p, child=c, axis=a).replace("prismatic", kind)
        for n, p, c, a, kind in (
            ("x", "base", "bridge", "1 0 0", "prismatic"),
            ("z", "bridge", "lifter", "0 0 1", "prismatic"),
            ("roll", "lifter", "tool", "0 1 0", "revolute"),
        )
    )
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint></robot>'
)
NOISE = {"q": {"std": 1e-4}, "v": {"std": 2e-3}}
SERVED = {"servo": {"kp": 300.0, "kv": 8.0, "limit": 40.0}}
PRESS = {
    "channels": {
        "q": {"std": 2e-6},
        "v": {"std": 2e-4},
        "wrench.wrist": {"body": "tool", "frame": "tool", "std": {"force": 0.02, "torque": 0.001}},
    },
    "contact": [
        {"bodies": ["tool", "wall"], "stiffness": 4000.0, "damping": 40.0, "friction": 0.4, "slip_velocity": 0.004}
    ],
}


def scene_of(folder: Path, model: str, *effects: Mapping[str, Any], **more: Any) -> Scene:
    """The scene of a model's text with these entries of `effects:` and other keys of a scenario."""
    (folder / "model.urdf").write_text(model)
    raw = {"model": "model.urdf", "weld": [{"body": "base"}], "channels": NOISE, **more, "effects": list(effects)}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(raw))
    return Scene.load(path)
