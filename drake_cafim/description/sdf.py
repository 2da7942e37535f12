"""Reading of an SDFormat file: collision meshes, frictions and springs are taken out before Drake's parser reads it."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from drake_cafim.description.description import SHOWN, Description, StatedEffect, describe_negative_damping, list_names
from drake_cafim.description.packages import Packages
from drake_cafim.description.xml_document import XmlDocument


def sdf_description(document: XmlDocument, packages: Packages) -> Description:
    """The description of an SDFormat file; files that it includes are read by Drake unchanged."""
    acting = [effect for joint in document.root.iter("joint") for effect in _take_effects(joint)]
    notes = (*_mend_dampings(document), *_remove_meshes(document, packages))
    named = [element for element in document.root.iter() if element.tag in ("link", "joint")]
    places = {element.get("name", ""): document.place(element) for element in named}
    return Description(document.text(), "sdf", tuple(acting), {}, {}, (), notes, places)


def _number(text: str, what: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{what} is {text[:60]!r}, expected a number") from None


def _take_effects(joint: Element) -> Iterator[StatedEffect]:
    """The joint's friction and spring as effects; they are taken out of its axis, lest they act twice."""
    name, dynamics = joint.get("name", ""), joint.find("axis/dynamics")
    if dynamics is None:
        return
    friction, stiffness, rest = (
        _number(dynamics.findtext(key) or "0", f"joint {name!r}: {key}")
        for key in ("friction", "spring_stiffness", "spring_reference")
    )
    for key in ("friction", "spring_stiffness", "spring_reference"):
        for child in dynamics.findall(key):
            dynamics.remove(child)
    if friction > 0.0:
        yield StatedEffect("joint_coulomb_friction", name, {"torque": friction})
    if stiffness > 0.0:
        yield StatedEffect("joint_spring", name, {"stiffness": stiffness, "rest": rest})


def _mend_dampings(document: XmlDocument) -> Iterator[str]:
    """Replace negative dampings by 0; a note for each."""
    for joint in document.root.iter("joint"):
        place = f"{document.place(joint)}: joint {joint.get('name')!r}"
        for given in joint.findall("axis/dynamics/damping"):
            damping = _number(given.text or "0", f"{place}: damping")
            if damping < 0.0:
                given.text = "0"
                yield describe_negative_damping(place, damping)


def _remove_meshes(document: XmlDocument, packages: Packages) -> Iterator[str]:
    """Take out collision meshes, and visual ones that the replay cannot show; a note for each of the two."""
    collisions: list[str] = []
    lost: list[str] = []
    for link in document.root.iter("link"):
        name = link.get("name", "")
        for kind, names in (("collision", collisions), ("visual", lost)):
            for shape in link.findall(kind):
                uri = shape.find("geometry/mesh/uri")
                if uri is None:
                    continue
                file = packages.file((uri.text or "").strip(), document.path)
                if kind == "visual" and file is not None and file.suffix.lower() in SHOWN:
                    uri.text = f"file://{file}"
                else:
                    link.remove(shape)
                    names.append(name)
    if collisions:
        yield f"collision meshes are not read, nothing can touch them ({list_names(collisions)})"
    if lost:
        yield f"not shown in the replay: {list_names(lost)}, since their meshes are not there or no {', '.join(SHOWN)}"
