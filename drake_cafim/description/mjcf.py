"""Reading of an MJCF: Drake's parser gets bodies, joints and primitive shapes, without classes, includes and meshes."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.description.description import Description, StatedEffect, describe_negative_damping, list_names
from drake_cafim.description.inertia import is_unphysical, nearest_physical_inertia
from drake_cafim.description.mjcf_actuators import driven_joints, effort_limits, read_actuators
from drake_cafim.description.mjcf_couplings import read_closures, read_couplings
from drake_cafim.description.mjcf_defaults import Defaults, bodies, include_all
from drake_cafim.description.mjcf_frames import Compiler, binding_range, set_pose
from drake_cafim.description.mjcf_mesh_inertia import MeshInertias
from drake_cafim.description.mjcf_meshes import Meshes
from drake_cafim.description.mjcf_servos import read_servos
from drake_cafim.description.packages import Packages
from drake_cafim.description.xml_document import XmlDocument, numbers
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

SHAPES = ("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box")
POSE = ("pos", "quat", "axisangle", "euler", "xyaxes", "zaxis")
GEOM = ("name", "type", "size", "mass", "density", "rgba", "fromto", *POSE)
JOINT = ("name", "type", "pos", "axis", "range", "limited", "damping")
BODY = ("name", *POSE)
COMPILER = ("angle", "eulerseq", "autolimits")


@dataclass
class _Extracted:
    """What is taken out of the file before Drake's parser reads it."""

    acting: list[StatedEffect] = field(default_factory=list)
    rotors: dict[str, float] = field(default_factory=dict)
    references: dict[str, float] = field(default_factory=dict)
    """Position (rad, m) of each joint in the file's reference pose."""
    notes: list[str] = field(default_factory=list)
    meshes: dict[str, list[Element]] = field(default_factory=dict)
    """Mesh geometries of each body."""
    compensated: list[str] = field(default_factory=list)
    """Bodies whose gravity the simulator of the file takes away."""


def mjcf_description(document: XmlDocument, packages: Packages) -> Description:
    """The description of an MJCF. Raises `InputError` that names the body or joint and the line."""
    # The order matters: included files hold classes, and effort limits and joints are found by their names.
    include_all(document)
    root = document.root
    compiler, defaults, taken = Compiler.of(root), Defaults.of(root), _Extracted()
    worlds = root.findall("worldbody")
    for world in worlds:
        _write_out(world, defaults, None)
        for body, childclass in bodies(world):
            _write_out(body, defaults, childclass)
    driving = read_actuators(root, defaults)
    _name_all(worlds)
    closures = read_closures(root)
    efforts, notes = effort_limits(driving, worlds, compiler)
    servos = read_servos(driving)
    inertias = MeshInertias(document.path)
    for world in worlds:
        _keep_shapes(world, taken)
        moving = _moving_bodies(world)
        for body, _ in bodies(world):
            _read_body(document, body, compiler, taken, inertias if body in moving else None)
    if taken.compensated:
        taken.notes.append(
            f"the file takes gravity from {list_names(taken.compensated)} (gravcomp), which is ignored; where the "
            "recorded efforts carry none, expected `gravity: [0, 0, 0]` in the scenario"
        )
    mimics, uncoupled = read_couplings(root, taken.references)
    taken.acting += servos.acting
    taken.notes += [*notes, *servos.notes, *uncoupled, *_describe_unread(root)]
    files = Meshes.of(root, defaults, compiler, document.path)
    shown = [mesh for body, geoms in taken.meshes.items() for mesh in files.visual_meshes(body, geoms)]
    lost = [body for body in taken.meshes if body not in {mesh.body for mesh in shown}]
    if taken.meshes:
        taken.notes.append(f"collision meshes are not read, nothing can touch them ({list_names(taken.meshes)})")
    if lost:
        taken.notes.append(f"not shown in the replay: {list_names(lost)}, since their mesh files are not there")
    places = {
        element.get("name", ""): document.place(element)
        for world in worlds for element in world.iter() if element.tag in ("body", "joint")
    }  # fmt: skip
    document.root = _parser_document(root, worlds, compiler, document)
    return Description(
        text=document.text(),
        form="xml",
        acting=tuple(taken.acting),
        rotor_inertias=taken.rotors,
        effort_limits=efforts,
        mimics=mimics,
        closures=closures,
        notes=tuple(taken.notes),
        places=places,
        positions=taken.references,
        shown=tuple(shown),
        servos=servos.servos,
        driven=driven_joints(driving, worlds),
    )


def _write_out(parent: Element, defaults: Defaults, childclass: str | None) -> None:
    for child in parent:
        if child.tag in ("joint", "geom"):
            defaults.write_out(child, childclass)


def _name_all(worlds: list[Element]) -> None:
    """Give names to bodies and joints that have none: body_<n> by order in the file, <body>_joint."""
    count = 0
    for world in worlds:
        for body, _ in bodies(world):
            count += 1
            name = body.attrib.setdefault("name", f"body_{count}")
            for k, joint in enumerate(body.findall("joint")):
                joint.attrib.setdefault("name", f"{name}_joint" if k == 0 else f"{name}_joint_{k + 1}")


def _moving_bodies(world: Element) -> set[Element]:
    """The bodies that move: those with a joint, and all below them."""
    jointed = [
        body for body, _ in bodies(world) if body.find("joint") is not None or body.find("freejoint") is not None
    ]
    return {below for body in jointed for below in body.iter("body")}


def _read_body(
    document: XmlDocument, body: Element, compiler: Compiler, taken: _Extracted, inertias: MeshInertias | None
) -> None:
    """Reduce a body to what Drake's parser reads; without `inertias` it stands still, so that its mass is nothing."""
    name = body.get("name", "")
    place = f"{document.place(body)}: body {name!r}"
    if float(body.get("gravcomp", "0")) != 0.0:
        taken.compensated.append(name)
    if compiler.says("inertiafromgeom", "auto") == "true" and body.find("geom") is not None:
        for overruled in body.findall("inertial"):
            body.remove(overruled)
    _lighten_other_groups(body, compiler)
    if inertias and body.find("inertial") is None and any(_heavy_mesh(geom) for geom in body.findall("geom")):
        inertias.write(body, place)
    weighs = _mend_inertia(body, place, compiler, taken)
    _keep_shapes(body, taken, weighs)
    free = [joint for joint in body.findall("joint") if joint.get("type") == "free"]
    for joint in free:
        joint.attrib = {key: value for key, value in joint.attrib.items() if key in ("name", "type")}
    moved = [joint for joint in body.findall("joint") if joint not in free]
    for joint in moved:
        _read_joint(document, joint, compiler, taken)
    _start_at_zero(body, moved, compiler, taken, place)
    for key in [key for key in body.attrib if key not in BODY]:
        del body.attrib[key]
    for child in [child for child in body if child.tag not in ("body", "joint", "freejoint", "geom", "inertial")]:
        body.remove(child)


def _read_joint(document: XmlDocument, joint: Element, compiler: Compiler, taken: _Extracted) -> None:
    """Move friction, spring, armature and reference from a joint to `taken`, and write its range as Drake reads it."""
    name, hinge = joint.get("name", ""), joint.get("type", "hinge") == "hinge"
    place = f"{document.place(joint)}: joint {name!r}"

    def first(attribute: str) -> float:
        try:
            return (numbers(joint, attribute, "0") or [0.0])[0]
        except ValueError:
            raise InputError(f"{place}: {attribute} is {joint.get(attribute)!r}, expected a number") from None

    def angle(attribute: str) -> float:
        return compiler.angle(first(attribute)) if hinge else first(attribute)

    if first("frictionloss") > 0.0:
        taken.acting.append(StatedEffect("joint_coulomb_friction", name, {"torque": first("frictionloss")}))
    if first("stiffness") > 0.0:
        spring = {"stiffness": first("stiffness"), "rest": angle("springref")}
        taken.acting.append(StatedEffect("joint_spring", name, spring))
    if first("armature") > 0.0:
        taken.rotors[name] = first("armature")
    if angle("ref") != 0.0:
        taken.references[name] = angle("ref")
    span = binding_range(joint, "limited", "range", compiler)
    joint.attrib.pop("range", None)
    joint.set("limited", "true" if span else "false")
    if span:
        joint.set("range", " ".join(map(repr, span)))
    if joint.get("damping"):
        damping = first("damping")
        joint.set("damping", repr(max(damping, 0.0)))
        if damping < 0.0:
            taken.notes.append(describe_negative_damping(place, damping))
    for key in [key for key in joint.attrib if key not in JOINT]:
        del joint.attrib[key]


def _start_at_zero(body: Element, joints: list[Element], compiler: Compiler, taken: _Extracted, place: str) -> None:
    """Set the body's pose to that at joint positions 0: X_PB J(−ref); in MJCF it is the pose at `ref`."""
    R, p = compiler.pose(body)
    for k, joint in enumerate(joints):
        if joint.get("name", "") not in taken.references:
            continue
        # J(−ref) of a later joint commutes with the earlier ones only if all of them slide
        if k > 0 and any(earlier.get("type", "hinge") != "slide" for earlier in joints[: k + 1]):
            raise InputError(
                f"{place} turns at {joint.get('name')!r} by a `ref` after other joints, expected ref 0 there"
            )
        axis = np.array(numbers(joint, "axis", "0 0 1"))
        axis, back = axis / np.linalg.norm(axis), -taken.references[joint.get("name", "")]
        if joint.get("type", "hinge") == "slide":
            p = p + R @ (back * axis)
            continue
        anchor = np.array(numbers(joint, "pos", "0 0 0"))
        turn = Rotation.from_rotvec(back * axis).as_matrix()
        R, p = R @ turn, p + R @ (anchor - turn @ anchor)
    if any(joint.get("name", "") in taken.references for joint in joints):
        set_pose(body, R, p)


def _lighten_other_groups(body: Element, compiler: Compiler) -> None:
    """Give no mass to geometries of groups from which the file does not infer any, as the merely visual ones."""
    lowest, highest = (int(word) for word in compiler.says("inertiagrouprange", "0 5").split())
    for geom in body.findall("geom"):
        if not lowest <= int(geom.get("group", "0")) <= highest:
            geom.set("mass", "0")


def _mend_inertia(body: Element, place: str, compiler: Compiler, taken: _Extracted) -> bool:
    """Replace an inertia that is not physically consistent, and remove an `<inertial>` without mass.

    Returns whether the body has a mass.
    """
    inertial = body.find("inertial")
    if inertial is None:
        return True
    if numbers(inertial, "mass", "0")[0] <= 0.0:
        body.remove(inertial)
        return False
    inertia = _moments(inertial)
    if is_unphysical(inertia):
        balanced = compiler.says("balanceinertia", "false") == "true"
        fitting = np.trace(inertia) / 3.0 * np.eye(3) if balanced else nearest_physical_inertia(inertia)
        moments = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(inertia))
        taken.notes.append(
            f"{place} has the principal moments {moments} kg m², of which none may exceed the sum of the others "
            f"or be negative: {'their mean is' if balanced else 'the nearest that a body can have are'} used"
        )
        xx, yy, zz, xy, xz, yz = (float(fitting[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        inertial.attrib.pop("diaginertia", None)
        inertial.set("fullinertia", " ".join(map(repr, (xx, yy, zz, xy, xz, yz))))
    return True


def _heavy_mesh(geom: Element) -> bool:
    """Whether the body's mass would have to be computed from this mesh."""
    massless = "0" in (geom.get("mass"), geom.get("density"))
    return bool(geom.get("mesh")) and geom.get("type") == "mesh" and not massless


def _moments(inertial: Element) -> Array:
    """The rotational inertia (3, 3) kg m² about the centre of mass, in the inertial frame's axes."""
    if inertial.get("fullinertia"):
        xx, yy, zz, xy, xz, yz = numbers(inertial, "fullinertia")
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.diag(numbers(inertial, "diaginertia", "0 0 0"))


def _keep_shapes(parent: Element, taken: _Extracted, weighs: bool = True) -> None:
    """Remove the geometries that Drake does not read, meshes among them; of a massless body all, as they have mass."""
    for geom in parent.findall("geom"):
        kind = geom.get("type", "sphere") if not geom.get("mesh") else "mesh"
        if kind not in SHAPES or not weighs or (kind == "box" and geom.get("fromto")):
            parent.remove(geom)
            if kind == "mesh":
                taken.meshes.setdefault(parent.get("name", "world"), []).append(geom)
            continue
        touches = geom.get("contype", "1") != "0" or geom.get("conaffinity", "1") != "0"
        slipping = geom.get("friction", "").split()
        for key in [key for key in geom.attrib if key not in GEOM]:
            del geom.attrib[key]
        if not touches:
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
        if slipping:
            geom.set("friction", slipping[0])


def _describe_unread(root: Element) -> Iterator[str]:
    """Notes on other physics of the file that is ignored."""
    for option in root.findall("option"):
        for key in ("density", "viscosity", "wind"):
            if any(numbers(option, key, "0")):
                yield f"the model's <option {key}> is ignored: no fluid is modelled"
        gravity = numbers(option, "gravity", "0 0 -9.81")
        if not np.allclose(gravity, [0.0, 0.0, -9.81]):
            yield f"the model's <option gravity> is {gravity}; the scenario's `gravity` is used"
    if any(flag.get("gravity") == "disable" for flag in root.findall("option/flag")):
        yield "the model's <flag gravity> is off; the scenario's `gravity` is used"
    for key in ("boundmass", "boundinertia"):
        least = Compiler.of(root).says(key, "0")
        if float(least) > 0.0:
            yield f"the model's <compiler {key}={least}> is ignored: masses and inertias are as written"
    total = Compiler.of(root).says("settotalmass", "-1")
    if float(total) > 0.0:
        yield f"the model's <compiler settotalmass={total}> is ignored: masses are as written"


def _parser_document(root: Element, worlds: list[Element], compiler: Compiler, document: XmlDocument) -> Element:
    """The document for Drake's parser: the compiler's conventions, bodies and geometries."""
    kept = Element("mujoco", {"model": root.get("model") or document.path.stem})
    SubElement(kept, "compiler", {key: compiler.attributes[key] for key in COMPILER if key in compiler.attributes})
    for world in worlds:
        for child in [child for child in world if child.tag not in ("body", "geom")]:
            world.remove(child)
        kept.append(world)
    return kept
