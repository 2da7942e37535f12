"""Values into an MJCF, and into the files that it includes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from drake_cafim.description.mjcf_frames import Compiler
from drake_cafim.dynamics.tree import Body
from drake_cafim.errors import InputError
from drake_cafim.export.values import JointValues, Values
from drake_cafim.export.xml_text import Node, XmlText, number, numbers, read_xml_text
from drake_cafim.typing import Array

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
DIAGONAL = 1e-9
"""Largest element beside the diagonal, over the largest on it, of an inertia that is written as `diaginertia`."""
FRICTION_TIME = "0.005 1"
"""`solreffriction` beside a friction: MuJoCo's own, 0.02 s, lets a joint that turns around slip far longer than dry
friction does; 0.005 s is what its usual step of 2 ms allows."""
SWITCHES = {
    "damping": ("passive", "damper"),
    "friction": ("constraint", "frictionloss"),
    "spring": ("passive", "spring"),
    "gain": ("actuation",),
}
"""The flags of <option> by which a file turns off what acts at a joint."""


@dataclass
class MjcfText:
    """The main file and those that it includes, by path, in the order in which they are read."""

    files: dict[Path, XmlText] = field(default_factory=dict)

    @property
    def main(self) -> XmlText:
        return next(iter(self.files.values()))

    @classmethod
    def read(cls, path: Path) -> "MjcfText":
        """Raises `InputError` for files that cannot be read, and for one that includes itself."""
        found = cls()
        found._read(path, path, ())
        return found

    def _read(self, path: Path, main: Path, above: tuple[Path, ...]) -> None:
        """Read a file and those that it includes; `above` are the files that lead to it, each included by the last."""
        if path.resolve() in above:
            raise InputError(f"{path}: it includes itself")
        if path in self.files:
            return
        self.files[path] = read_xml_text(path)
        for node in list(self.files[path].root.iter("include")):
            self._read(self._included(node, path, main), main, (*above, path.resolve()))

    def _included(self, node: Node, path: Path, main: Path) -> Path:
        name = node.get("file")
        for folder in (main.parent, path.parent):
            if (folder / name).is_file():
                return folder / name
        raise InputError(f"{path}: include names {name!r}, which is not there")

    def sections(self, tag: str) -> Iterator[Node]:
        """The elements `tag` below <mujoco>, in the order of the expanded document."""
        yield from (node for node in self._expanded(self.main.root, self.main.path) if node.tag == tag)

    def below(self, node: Node, path: Path | None = None) -> Iterator[Node]:
        """The children of a node, those of included files in place of the includes."""
        yield from self._expanded(node, path or self._path_of(node))

    def _path_of(self, node: Node) -> Path:
        root = node
        while root.parent is not None:
            root = root.parent
        return next(path for path, file in self.files.items() if file.root is root)

    def _expanded(self, node: Node, path: Path) -> Iterator[Node]:
        for child in node.children:
            if child.tag == "include":
                included = self._included(child, path, self.main.path)
                yield from self._expanded(self.files[included].root, included)
            else:
                yield child

    def bodies(self, node: Node) -> Iterator[Node]:
        """All bodies below a node, parents first."""
        for child in self.below(node):
            if child.tag == "body":
                yield child
                yield from self.bodies(child)


def write_mjcf(text: MjcfText, values: Values) -> list[str]:
    """Change the files' elements; returns a sentence for each value that could not be written."""
    bodies, joints = _named(text)
    root = Element("mujoco")
    for node in text.sections("compiler"):
        root.append(Element("compiler", node.attributes))
    compiler = Compiler.of(root)
    lost: list[str] = []
    for name, body in values.bodies.items():
        if name not in bodies:
            lost.append(f"inertia of {name}: the file has no body of this name")
        elif compiler.says("inertiafromgeom", "auto") == "true":
            lost.append(f"inertia of {name}: <compiler inertiafromgeom> takes it from the shapes")
        else:
            _set_inertial(text, bodies[name], body, compiler)
    for name, item in values.joints.items():
        if name not in joints:
            lost.append(f"values of {name}: the file has no joint of this name")
            continue
        off = _switched_off(text)
        lost += [
            f"{what} of {name}: the file turns it off, <flag {flag}>"
            for what, flag in off.items()
            if getattr(item, what) is not None
        ]
        item = _without(item, off)
        _set_joint(joints[name], item, compiler)
        if item.gain is not None:
            lost += _set_gain(text, name, item.gain)
    if values.gravity is not None:
        _set_option(text, "gravity", numbers(tuple(values.gravity)))
    return lost


def _without(values: JointValues, off: Mapping[str, str]) -> JointValues:
    """The values without those that are turned off."""
    none: dict[str, Any] = dict.fromkeys(off)
    return replace(values, **none)


def _switched_off(text: MjcfText) -> dict[str, str]:
    """Those of `SWITCHES` that the file turns off, each with the flag; of several flags the last counts."""
    flags: dict[str, str] = {}
    for option in text.sections("option"):
        for flag in option.findall("flag"):
            flags |= flag.attributes
    return {what: name for what, names in SWITCHES.items() for name in names if flags.get(name) == "disable"}


def _named(text: MjcfText) -> tuple[dict[str, Node], dict[str, Node]]:
    """Bodies and joints by the names that the reader of descriptions gives them, see `description.mjcf`."""
    bodies: dict[str, Node] = {}
    joints: dict[str, Node] = {}
    count = 0
    for world in text.sections("worldbody"):
        for body in text.bodies(world):
            count += 1
            name = body.get("name") or f"body_{count}"
            bodies[name] = body
            own = [child for child in text.below(body) if child.tag == "joint"]
            for k, joint in enumerate(own):
                joints[joint.get("name") or (f"{name}_joint" if k == 0 else f"{name}_joint_{k + 1}")] = joint
    return bodies, joints


def _set_inertial(text: MjcfText, node: Node, body: Body, compiler: Compiler) -> None:
    inertial = next((child for child in text.below(node) if child.tag == "inertial"), None)
    moments = body.I_BBcm_B
    if inertial is None:
        node.first.append(
            f'<inertial pos="{numbers(tuple(body.p_BBcm))}" mass="{number(body.mass)}" '
            f'fullinertia="{numbers(_full(moments))}"/>'
        )
        return
    R, _ = compiler.pose(Element("inertial", inertial.attributes))
    turned: Array = R.T @ moments @ R
    beside = turned - np.diag(np.diag(turned))
    inertial.set("pos", numbers(tuple(body.p_BBcm)))
    inertial.set("mass", number(body.mass))
    if np.max(np.abs(beside)) <= DIAGONAL * np.max(np.abs(turned)):
        inertial.remove("fullinertia")
        inertial.set("diaginertia", numbers(tuple(np.diag(turned))))
        return
    # MuJoCo takes a full inertia in the body's axes alone
    for name in ("diaginertia", *ORIENTATIONS):
        inertial.remove(name)
    inertial.set("fullinertia", numbers(_full(moments)))


def _full(inertia: Array) -> tuple[float, ...]:
    return tuple(float(inertia[at]) for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def _set_joint(joint: Node, values: JointValues, compiler: Compiler) -> None:
    stated = {"damping": values.damping, "frictionloss": values.friction, "armature": values.rotor_inertia}
    for name, value in stated.items():
        if value is not None:
            joint.set(name, number(value))
    if values.friction is not None and not joint.get("solreffriction"):
        joint.set("solreffriction", FRICTION_TIME)
    if values.spring is not None:
        stiffness, rest = values.spring
        in_degrees = not values.prismatic and compiler.says("angle", "degree") != "radian"
        joint.set("stiffness", number(stiffness))
        joint.set("springref", number(float(np.rad2deg(rest)) if in_degrees else rest))
    if values.effort_limit is not None:
        joint.set("actuatorfrcrange", numbers((-values.effort_limit, values.effort_limit)))
        joint.set("actuatorfrclimited", "true")


def _set_gain(text: MjcfText, joint: str, gain: float) -> list[str]:
    """Multiply the gear of the joint's motor; a sentence where there is none, or one that is not linear in control."""
    found = [
        node for section in text.sections("actuator") for node in text.below(section) if node.get("joint") == joint
    ]
    motors = [node for node in found if node.tag == "motor" or (node.tag == "general" and not node.get("biastype"))]
    if len(motors) != 1 or len(found) != 1:
        what = f"{len(found)} actuators" if len(found) != 1 else f"a <{found[0].tag}>"
        return [f"the gain {gain:.4g} of {joint}: it is driven by {what}, expected one <motor>, whose gear is scaled"]
    motor = motors[0]
    gear = [float(word) for word in (motor.get("gear") or _default_gear(text, motor)).split()]
    motor.set("gear", numbers([gain * value for value in gear]))
    return []


def _default_gear(text: MjcfText, motor: Node) -> str:
    """The gear of the motor's default class, or of the main one; MuJoCo's own is 1."""
    classes: dict[str, str] = {}

    def gather(section: Node, name: str, inherited: str) -> None:
        gear = inherited
        for tag in ("general", motor.tag):
            gear = next(
                (node.get("gear") for node in text.below(section) if node.tag == tag and node.get("gear")), gear
            )
        classes[name] = gear
        for nested in text.below(section):
            if nested.tag == "default":
                gather(nested, nested.get("class"), gear)

    for section in text.sections("default"):
        gather(section, section.get("class") or "main", "1")
    return classes.get(motor.get("class") or "main", "1")


def _set_option(text: MjcfText, name: str, value: str) -> None:
    options = list(text.sections("option"))
    if options:
        options[-1].set(name, value)
    else:
        text.main.root.first.append(f'<option {name}="{value}"/>')


def addresses_of(text: MjcfText) -> Mapping[str, str]:
    """The folders that meshes and textures are read from, by the attribute of <compiler> that says so."""
    stated: dict[str, str] = {}
    for node in text.sections("compiler"):
        stated |= node.attributes
    both = stated.get("assetdir", "")
    return {"meshdir": stated.get("meshdir", both), "texturedir": stated.get("texturedir", both)}


def set_addresses(text: MjcfText, folders: Mapping[str, str]) -> None:
    """Let meshes and textures be read from these folders."""
    nodes = list(text.sections("compiler"))
    for name, folder in folders.items():
        for node in nodes:
            if name in node.attributes:
                node.remove(name)
        if nodes:
            nodes[-1].set(name, folder)
    if not nodes:
        text.main.root.first.append("<compiler " + " ".join(f'{k}="{v}"' for k, v in folders.items()) + "/>")
