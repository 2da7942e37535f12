"""Angles and poses as MJCF writes them."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.description.xml_document import numbers
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Compiler:
    """How the file's numbers are read: all `<compiler>` elements together."""

    attributes: dict[str, str]

    @classmethod
    def of(cls, root: Element) -> "Compiler":
        merged: dict[str, str] = {}
        for element in root.findall("compiler"):
            merged |= dict(element.attrib)
        return cls(merged)

    def says(self, name: str, default: str) -> str:
        return self.attributes.get(name, default)

    def angle(self, value: float) -> float:
        """rad of an angle of the file."""
        return value if self.says("angle", "degree") == "radian" else float(np.deg2rad(value))

    def pose(self, element: Element) -> tuple[Array, Array]:
        """R (3, 3) and p (3,) of an element in its parent."""
        p = np.array(numbers(element, "pos", "0 0 0"))
        return self._rotation(element).as_matrix(), p

    def _rotation(self, element: Element) -> Rotation:
        if element.get("quat"):
            return Rotation.from_quat(numbers(element, "quat"), scalar_first=True)
        if element.get("axisangle"):
            *axis, angle = numbers(element, "axisangle")
            return Rotation.from_rotvec(self.angle(angle) * np.array(axis) / np.linalg.norm(axis))
        if element.get("euler"):
            angles = [self.angle(one) for one in numbers(element, "euler")]
            sequence = self.says("eulerseq", "xyz")
            # scipy: capitals turn with the body, as small letters do here
            return Rotation.from_euler(sequence.swapcase(), angles)
        if element.get("xyaxes"):
            x, y = np.array(numbers(element, "xyaxes")).reshape(2, 3)
            x = x / np.linalg.norm(x)
            y = y - (x @ y) * x
            y = y / np.linalg.norm(y)
            return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))
        if element.get("zaxis"):
            return _shortest(np.array(numbers(element, "zaxis")))
        return Rotation.identity()


def _shortest(z: Array) -> Rotation:
    """The smallest rotation that takes the z axis to `z` (3,)."""
    z = z / np.linalg.norm(z)
    across = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, z[2]))
    return Rotation.from_rotvec(angle * (across / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])))


def set_pose(element: Element, R: Array, p: Array) -> None:
    """Gives the element this pose, R (3, 3) and p (3,)."""
    for key in ("axisangle", "euler", "xyaxes", "zaxis"):
        element.attrib.pop(key, None)
    element.set("pos", " ".join(map(repr, p.tolist())))
    quaternion = Rotation.from_matrix(R).as_quat(scalar_first=True)
    element.set("quat", " ".join(map(repr, quaternion.tolist())))


def limited(element: Element, flag: str, span: str, compiler: Compiler) -> list[float]:
    """The two numbers of the range `span` where it is one that binds by `flag` (true, false, auto), else none."""
    given = numbers(element, span)
    says = element.get(flag, "auto")
    if says == "auto":
        says = "true" if given and compiler.says("autolimits", "true") == "true" else "false"
    return given if says == "true" and len(given) == 2 else []
