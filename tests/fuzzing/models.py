"""Hostile model files: small URDF, SDFormat, MJCF and directives, damaged as trees or as bytes."""

import copy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml

from drake_cafim.scene.scene import Scene
from tests.fuzzing.mutate import damage_bytes, damage_tree
from tests.fuzzing.verdict import judge

LINK = """<link name="{name}"><inertial><origin xyz="0 0 -0.1" rpy="0 0.1 0"/><mass value="1.2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="0.1 0.2 0.3"/></geometry><material name="red"><color rgba="1 0 0 1"/></material></visual>
<collision><geometry><sphere radius="0.05"/></geometry></collision></link>"""
URDF = f"""<robot name="arm"><link name="world"/>
<joint name="on" type="fixed"><parent link="world"/><child link="base"/>
</joint>{LINK.format(name="base")}{LINK.format(name="upper")}{LINK.format(name="lower")}
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="20" velocity="9"/><dynamics damping="0.1" friction="0.2"/></joint>
<joint name="elbow" type="prismatic"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="20" velocity="9"/><mimic joint="shoulder" multiplier="2" offset="0.1"/></joint>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="shoulder"/><actuator name="m">
<mechanicalReduction>50</mechanicalReduction></actuator></transmission></robot>"""
SDF = """<sdf version="1.7"><model name="arm">
<link name="base"><inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy>
<izz>0.1</izz></inertia></inertial></link><link name="upper"><pose>0 0 0.2 0 0 0</pose><inertial><mass>1</mass>
<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial><collision name="c"><geometry>
<sphere><radius>0.1</radius></sphere></geometry></collision></link>
<joint name="on" type="fixed"><parent>world</parent><child>base</child></joint>
<joint name="shoulder" type="revolute"><parent>base</parent>
<child>upper</child><axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>5</effort></limit><dynamics>
<damping>0.1</damping><friction>0.2</friction><spring_stiffness>1</spring_stiffness></dynamics></axis></joint></model></sdf>"""
MJCF = """<mujoco model="arm"><compiler angle="radian" autolimits="true"/><option gravity="0 0 -9.81"/>
<default>
<joint damping="0.1" armature="0.01"/><default class="big"><geom size="0.1" rgba="1 0 0 1"/></default></default>
<worldbody><body name="base" pos="0 0 1"><geom type="box" size="0.1 0.1 0.1" mass="2"/>
<body name="upper" pos="0 0 0.1" childclass="big" euler="0 0 0.1"><joint name="shoulder" axis="0 1 0" range="-2 2"
frictionloss="0.2" stiffness="1" springref="0.1" ref="0.1"/><geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/><body name="lower" quat="1 0 0 0"><joint name="elbow"
type="slide"/><geom class="big" type="sphere"/></body></body></body></worldbody>
<actuator><motor joint="shoulder" gear="50" ctrlrange="-1 1"/>
<position joint="elbow" kp="10" forcerange="-3 3"/></actuator>
<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 1 0 0 0"/></equality></mujoco>"""
DIRECTIVES = {
    "directives": [
        {"add_model": {"name": "arm", "file": "part.urdf", "default_joint_positions": {"shoulder": [0.1]}}},
        {"add_model": {"name": "more", "file": "rest.sdf"}},
        {"add_frame": {"name": "f", "X_PF": {"base_frame": "arm::base", "translation": [0.0, 0.0, 0.1]}}},
        {"add_weld": {"parent": "arm::lower", "child": "more::plate"}},
    ]
}
REST = """<sdf version="1.7"><model name="rest">
<link name="plate"><inertial><mass>1</mass></inertial></link></model></sdf>"""
COUPLING = '<mimic joint="shoulder" multiplier="2" offset="0.1"/>'
PLAIN_URDF = URDF.replace(COUPLING, "")
PLAIN_MJCF = MJCF[: MJCF.index("<equality>")] + "</mujoco>"
TEXTS = (
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "x",
    "1 2",
    "0 0 0",
    "1 2 3 4 5 6 7 8",
    "9" * 400,
    "base",
    "upper",
    "world",
)
TEXTS += (
    "-1e-9",
    "true",
    "revolute",
    "free",
    "ball",
    "fixed",
    "floating",
    "mesh",
    "a\nb",
    "é",
    "../..",
    "package://x/y",
)


class ModelCases:
    """Inputs that are models; each is a number, and the same number is the same input."""

    def __init__(self) -> None:
        self._trees = {"urdf": (PLAIN_URDF, PLAIN_URDF, URDF), "sdf": (SDF,), "xml": (PLAIN_MJCF, PLAIN_MJCF, MJCF)}

    def run(self, number: int, folder: Path) -> str:
        """What becomes of model `number`, written into `folder`."""
        rng = np.random.default_rng(number)
        path = self._write(rng, folder)
        return judge(lambda: Scene.load(path), [path.name])

    def _write(self, rng: np.random.Generator, folder: Path) -> Path:
        if rng.random() < 0.12:
            path = folder / "model.dmd.yaml"
            (folder / "part.urdf").write_text(PLAIN_URDF)
            (folder / "rest.sdf").write_text(REST)
            path.write_text(yaml.dump(damage_tree(DIRECTIVES, rng), allow_unicode=True), "utf-8", errors="replace")
            return path
        suffix = str(rng.choice(list(self._trees)))
        path = folder / f"model.{suffix}"
        seed = str(rng.choice(self._trees[suffix]))
        if rng.random() < 0.25:
            others = [texts[0].encode() for texts in self._trees.values()]
            path.write_bytes(damage_bytes(seed.encode(), rng, others))
        else:
            root = ElementTree.fromstring(seed)
            _damage_elements(root, rng)
            path.write_bytes(ElementTree.tostring(root))
        return path


def _damage_elements(root: ElementTree.Element, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(1, 4))):
        elements = list(root.iter())
        element = elements[int(rng.integers(len(elements)))]
        other = elements[int(rng.integers(len(elements)))]
        kind = int(rng.integers(8))
        text = TEXTS[int(rng.integers(len(TEXTS)))]
        if kind <= 2 and element.attrib:
            element.set(str(rng.choice(list(element.attrib))), text)
        elif kind == 3 and element.attrib:
            del element.attrib[str(rng.choice(list(element.attrib)))]
        elif kind == 4:
            element.text = text
        elif kind == 5 and len(element):
            element.remove(element[int(rng.integers(len(element)))])
        elif kind == 6:
            element.append(copy.deepcopy(other))
        elif kind == 7:
            element.tag = other.tag
        else:
            element.set(str(rng.choice(["name", "type", "class", "pos", "drake:x", "file"])), text)
