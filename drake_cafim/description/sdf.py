"""An SDFormat file as Drake's parser takes it: without collision meshes, frictions and springs."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from drake_cafim.description.description import SHOWN, Acting, Description, listed
from drake_cafim.description.packages import Packages
from drake_cafim.description.xml_document import XmlDocument


def sdf_description(document: XmlDocument, packages: Packages) -> Description:
    """The description of an SDFormat file; the files that it includes are read by Drake as they are."""
    acting = [effect for joint in document.root.iter("joint") for effect in _acting(joint)]
    notes = tuple(_without_meshes(document, packages))
    named = [element for element in document.root.iter() if element.tag in ("link", "joint")]
    places = {element.get("name", ""): document.place(element) for element in named}
    return Description(document.text(), "sdf", tuple(acting), {}, {}, (), notes, places)


def _acting(joint: Element) -> Iterator[Acting]:
    """Takes friction and spring out of the joint's axis."""
    name, dynamics = joint.get("name", ""), joint.find("axis/dynamics")
    if dynamics is None:
        return
    friction, stiffness, rest = (
        float(dynamics.findtext(key) or 0.0) for key in ("friction", "spring_stiffness", "spring_reference")
    )
    for key in ("friction", "spring_stiffness", "spring_reference"):
        for child in dynamics.findall(key):
            dynamics.remove(child)
    if friction > 0.0:
        yield Acting("joint_coulomb_friction", name, {"torque": friction})
    if stiffness > 0.0:
        yield Acting("joint_spring", name, {"stiffness": stiffness, "rest": rest})


def _without_meshes(document: XmlDocument, packages: Packages) -> Iterator[str]:
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
        yield f"collision meshes are not read: nothing touches them ({listed(collisions)})"
    if lost:
        yield f"not shown in the replay: {listed(lost)}, since their meshes are not there or no {', '.join(SHOWN)}"
