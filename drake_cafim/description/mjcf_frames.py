"""Angles, poses and ranges in the notations of MJCF."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.description.xml_document import numbers
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Compiler:
    """The file's conventions for numbers: the attributes of all its `<compiler>` elements."""

    attributes: dict[str, str]

    @classmethod
    def of(cls, root: Element) -> "Compiler":
        """The merged attributes; of equal ones the last counts."""
        merged: dict[str, str] = {}
        for element in root.findall("compiler"):
            merged |= dict(element.attrib)
        return cls(merged)

    def says(self, name: str, default: str) -> str:
        """The attribute `name`, or `default` where the file has none."""
        return self.attributes.get(name, default)

    def angle(self, value: float) -> float:
        """An angle of the file in rad; the file's unit is degrees unless it states radians."""
        return value if self.says("angle", "degree") == "radian" else float(np.deg2rad(value))

    def pose(self, element: Element) -> tuple[Array, Array]:
        """R_PE (3, 3) and p_PE (3,) m of an element E in its parent P."""
        p = np.array(numbers(element, "pos", "0 0 0"))
        return self._rotation(element).as_matrix(), p

    def _rotation(self, element: Element) -> Rotation:
        if element.get("quat"):
            return Rotation.from_quat(numbers(element, "quat"), scalar_first=True)
        if element.get("axisangle"):
            *axis, angle = numbers(element, "axisangle")
            return Rotation.from_rotvec(self.angle(angle) * np.array(axis) / np.linalg.norm(axis))
        if element.get("euler"):
            angles = [self.angle(value) for value in numbers(element, "euler")]
            sequence = self.says("eulerseq", "xyz")
            # MJCF writes intrinsic rotations in small letters, scipy in capitals
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
    """The rotation by the smallest angle that takes the z axis to the direction `z` (3,)."""
    z = z / np.linalg.norm(z)
    across = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, z[2]))
    return Rotation.from_rotvec(angle * (across / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])))


def set_pose(element: Element, R: Array, p: Array) -> None:
    """Write the pose R (3, 3), p (3,) m to the element as `quat` and `pos`, in place of any other notation."""
    for key in ("axisangle", "euler", "xyaxes", "zaxis"):
        element.attrib.pop(key, None)
    element.set("pos", " ".join(map(repr, p.tolist())))
    quaternion = Rotation.from_matrix(R).as_quat(scalar_first=True)
    element.set("quat", " ".join(map(repr, quaternion.tolist())))


def binding_range(element: Element, flag: str, span: str, compiler: Compiler) -> list[float]:
    """The two numbers of the attribute `span` if the limit is active by the attribute `flag`, else an empty list.

    `flag` is true, false or auto; auto means true where a range is given, unless the compiler has autolimits off.
    """
    given = numbers(element, span)
    says = element.get(flag, "auto")
    if says == "auto":
        says = "true" if given and compiler.says("autolimits", "true") == "true" else "false"
    return given if says == "true" and len(given) == 2 else []
