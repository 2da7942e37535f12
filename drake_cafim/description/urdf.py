"""Reading of a URDF: collision meshes, mimics, frictions and unknown elements are taken out for Drake's parser."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from drake_cafim.description.description import (
    SHOWN,
    Description,
    Mimic,
    StatedEffect,
    describe_negative_damping,
    list_names,
)
from drake_cafim.description.inertia import is_unphysical, nearest_physical_inertia
from drake_cafim.description.packages import Packages
from drake_cafim.description.xml_document import XmlDocument, numbers
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
UNREAD = ("safety_controller", "calibration")
"""Elements of a joint that are for a controller on the robot and not physics."""
LEAST_MASS = 1e-9
"""kg, mass of a body that has an inertia but no mass, which Drake refuses."""
MOVING = ("revolute", "continuous", "prismatic")


def urdf_description(document: XmlDocument, packages: Packages) -> Description:
    """The description of a URDF. Raises `InputError` that names the body or joint and the line."""
    root = document.root
    _refuse_macros(document)
    _refuse_empty_ranges(document)
    if not root.get("name"):
        root.set("name", document.path.stem)
    notes = [*_remove_empty_shapes(document), *_remove_meshes(document, packages), *_mend_inertias(document)]
    notes += _mend_dampings(document)
    mimics = tuple(_take_mimics(document))
    acting = tuple(_take_frictions(document))
    limits = dict(_effort_limits(document))
    notes += _remove_transmissions(document)
    _inline_colors(root)
    for joint in root.findall("joint"):
        for child in [child for child in joint if child.tag in UNREAD]:
            joint.remove(child)
    named = [*root.findall("link"), *root.findall("joint")]
    places = {element.get("name", ""): document.place(element) for element in named}
    return Description(document.text(), "urdf", acting, {}, limits, mimics, tuple(notes), places)


def _refuse_macros(document: XmlDocument) -> None:
    for element in document.root.iter():
        if element.tag.startswith("xacro:"):
            raise InputError(
                f"{document.place(element)}: found <{element.tag}>, which is a macro; expected the URDF that "
                f"`xacro {document.path.name}` writes"
            )


def _refuse_empty_ranges(document: XmlDocument) -> None:
    for joint in document.root.findall("joint"):
        limit, place = joint.find("limit"), f"{document.place(joint)}: joint {joint.get('name')!r}"
        if limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        lower, upper = (_number(limit, key, place) for key in ("lower", "upper"))
        if lower > upper:
            raise InputError(f"{place} has the limits {lower:g} to {upper:g}, expected the lower one first")


def _remove_empty_shapes(document: XmlDocument) -> Iterator[str]:
    """Take out boxes, cylinders and spheres without an extent, which Drake refuses; a note on them."""
    empty = []
    for link in document.root.findall("link"):
        for shape in [child for child in link if child.tag in ("visual", "collision")]:
            solids = shape.findall("geometry/*")
            sizes = " ".join(solid.get(key, "") for solid in solids for key in ("size", "radius", "length"))
            if any(_is_zero(word) for word in sizes.split()):
                link.remove(shape)
                empty.append(link.get("name", ""))
    if empty:
        yield f"shapes without an extent are left out ({list_names(empty)})"


def _is_zero(word: str) -> bool:
    try:
        return float(word) == 0.0
    except ValueError:
        return False  # Drake's parser says what is wrong with it


def _remove_meshes(document: XmlDocument, packages: Packages) -> Iterator[str]:
    """Take out collision meshes, and visual ones that the replay cannot show; notes on both."""
    collisions: list[str] = []
    lost: dict[str, list[str]] = {}
    for link in document.root.findall("link"):
        name = link.get("name", "")
        for shape in link.findall("collision"):
            if shape.find("geometry/mesh") is not None:
                link.remove(shape)
                collisions.append(name)
        for shape in link.findall("visual"):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            address = mesh.get("filename", "")
            file = packages.file(address, document.path)
            if file is not None and file.suffix.lower() in SHOWN:
                mesh.set("filename", f"file://{file}")
            else:
                link.remove(shape)
                lost.setdefault(_why_lost(address, document, packages), []).append(name)
    if collisions:
        yield f"collision meshes are not read, nothing can touch them ({list_names(collisions)})"
    for why, names in lost.items():
        yield f"not shown in the replay: {list_names(names)}, since {why}"


def _inline_colors(root: Element) -> None:
    """Write each visual's colour into the visual, since many files define materials twice or not at all."""
    colors = {
        material.get("name"): color.get("rgba", "")
        for material in root.iter("material")
        if (color := material.find("color")) is not None
    }
    visuals = root.findall("link/visual")
    for k, visual in enumerate(visuals):
        for material in visual.findall("material"):
            color = material.find("color")
            rgba = colors.get(material.get("name")) if color is None else color.get("rgba")
            visual.remove(material)
            if rgba:
                own = SubElement(visual, "material", {"name": f"color_{k}"})
                SubElement(own, "color", {"rgba": rgba})
    for material in root.findall("material"):
        root.remove(material)


def _why_lost(address: str, document: XmlDocument, packages: Packages) -> str:
    """Why the replay cannot show the mesh, as the end of a sentence."""
    if packages.file(address, document.path) is not None:
        return f"meshes are shown that end in {', '.join(SHOWN)}"
    if "://" in address:
        return packages.explain_missing(address, document.path).replace(address, "it")
    return "their mesh files are not there"


def _mend_inertias(document: XmlDocument) -> Iterator[str]:
    """Replace inertias that are not physically consistent and remove zero ones; a note for each that is changed."""
    for link in document.root.findall("link"):
        inertial, name = link.find("inertial"), link.get("name", "")
        if inertial is None:
            continue
        place = f"{document.place(inertial)}: body {name!r}"
        mass, inertia = _mass(inertial, place), _moments(inertial, place)
        if mass < 0.0:
            raise InputError(f"{place} has the mass {mass:g} kg, expected 0 or more")
        if mass == 0.0:
            if not np.any(inertia):
                link.remove(inertial)
                continue
            yield f"{place} has an inertia but no mass: {LEAST_MASS:g} kg are used"
            for given in inertial.findall("mass"):
                inertial.remove(given)
            SubElement(inertial, "mass", {"value": repr(LEAST_MASS)})
        if is_unphysical(inertia):
            _set_moments(inertial, nearest_physical_inertia(inertia))
            moments = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(inertia))
            yield (
                f"{place} has the principal moments {moments} kg m², of which none may exceed the sum of the others "
                "or be negative: the nearest that a body can have are used"
            )


def _mass(inertial: Element, place: str) -> float:
    mass = inertial.find("mass")
    return 0.0 if mass is None else _number(mass, "value", place)


def _moments(inertial: Element, place: str) -> Array:
    """The rotational inertia (3, 3) kg m² about the centre of mass, in the inertial frame's axes."""
    given = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (0.0 if given is None else _number(given, key, place) for key in MOMENTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _set_moments(inertial: Element, inertia: Array) -> None:
    given = inertial.find("inertia")
    assert given is not None
    for key in MOMENTS:
        given.set(key, repr(float(inertia["xyz".index(key[1]), "xyz".index(key[2])])))


def _number(element: Element, attribute: str, place: str) -> float:
    text = element.get(attribute, "0")
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{place}: {attribute} is {text!r}, expected a number") from None


def _take_mimics(document: XmlDocument) -> Iterator[Mimic]:
    """Take the `<mimic>` elements out; those of joints that move are yielded, those of fixed ones have no meaning."""
    joints = {joint.get("name", ""): joint for joint in document.root.findall("joint")}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        joint.remove(mimic)
        if joint.get("type") not in MOVING:
            continue
        place, leader = f"{document.place(joint)}: joint {name!r}", mimic.get("joint", "")
        if leader not in joints:
            raise InputError(f"{place} mimics {leader!r}, which is no joint of the model")
        multiplier = _number(mimic, "multiplier", place) if mimic.get("multiplier") else 1.0
        yield Mimic(name, leader, multiplier, _number(mimic, "offset", place))


def _take_frictions(document: XmlDocument) -> Iterator[StatedEffect]:
    """Take `<dynamics friction>`, which Drake's parser ignores, out as Coulomb friction."""
    for joint in document.root.findall("joint"):
        dynamics, name = joint.find("dynamics"), joint.get("name", "")
        if dynamics is None:
            continue
        friction = _number(dynamics, "friction", f"{document.place(joint)}: joint {name!r}")
        dynamics.attrib.pop("friction", None)
        if friction < 0.0:
            raise InputError(
                f"{document.place(joint)}: joint {name!r} has the friction {friction:g}, expected 0 or more"
            )
        if friction > 0.0 and joint.get("type") in MOVING:
            yield StatedEffect("joint_coulomb_friction", name, {"torque": friction})


def _mend_dampings(document: XmlDocument) -> Iterator[str]:
    """Replace negative dampings by 0; a note for each."""
    for joint in document.root.findall("joint"):
        dynamics, place = joint.find("dynamics"), f"{document.place(joint)}: joint {joint.get('name')!r}"
        if dynamics is not None and (damping := _number(dynamics, "damping", place)) < 0.0:
            dynamics.set("damping", "0")
            yield describe_negative_damping(place, damping)


def _effort_limits(document: XmlDocument) -> Iterator[tuple[str, float]]:
    """The effort limits of joints that are above zero; exporters write 0 for an unknown limit."""
    for joint in document.root.findall("joint"):
        limit = joint.find("limit")
        effort = numbers(limit, "effort") if limit is not None else []
        if effort and effort[0] > 0.0 and joint.get("type") in MOVING:
            yield joint.get("name", ""), effort[0]


def _remove_transmissions(document: XmlDocument) -> Iterator[str]:
    """Remove gear reductions, and transmissions that are not simple ones of a moving joint; a note on the latter.

    Actuators of the same name get their joint's beside it, since Drake takes each name once.
    """
    moving = {joint.get("name") for joint in document.root.findall("joint") if joint.get("type") in MOVING}
    other, actuators = [], set[str]()
    for transmission in document.root.findall("transmission"):
        kind = (transmission.findtext("type") or transmission.get("type") or "").strip()
        joints = [joint.get("name") for joint in transmission.findall("joint")]
        if not kind.endswith("SimpleTransmission") or len(joints) != 1 or joints[0] not in moving:
            document.root.remove(transmission)
            if not kind.endswith("SimpleTransmission"):
                other += [str(joint) for joint in joints]
            continue
        for element in [transmission, *transmission]:
            for child in element.findall("mechanicalReduction"):
                element.remove(child)  # it converts motor efforts; a recording has those at the joint
        for actuator in transmission.findall("actuator"):
            if actuator.get("name", "") in actuators:
                actuator.set("name", f"{actuator.get('name')} of {joints[0]}")
            actuators.add(actuator.get("name", ""))
    if other:
        yield f"transmissions other than simple ones are ignored: efforts are those at the joints ({list_names(other)})"
