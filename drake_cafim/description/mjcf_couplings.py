"""Reading of an MJCF's equality constraints between joints, and of its tendons."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from drake_cafim.description.description import Closure, Mimic, list_names
from drake_cafim.description.xml_document import numbers


def read_couplings(root: Element, references: Mapping[str, float]) -> tuple[tuple[Mimic, ...], list[str]]:
    """The joints that follow another one linearly, and notes on the constraints that are ignored.

    `<equality joint>` states q₁ − ref₁ = a₀ + a₁ (q₂ − ref₂), thus q₁ = a₁ q₂ + (ref₁ + a₀ − a₁ ref₂); `references`
    are ref (rad, m) by joint. Constraints with powers of q₂, and those of bodies or tendons, are ignored.
    """
    mimics, others = [], []
    for element in [constraint for section in root.findall("equality") for constraint in section]:
        if not _acts(element):
            continue
        coefficients = (numbers(element, "polycoef") or [0.0, 1.0]) + [0.0, 0.0]
        joint, leader = element.get("joint1"), element.get("joint2")
        if element.tag != "joint" or not joint or not leader or any(coefficients[2:]):
            others.append(element.get("name") or f"{element.tag} of {element.get('body1') or joint or 'tendons'}")
            continue
        offset = references.get(joint, 0.0) + coefficients[0] - coefficients[1] * references.get(leader, 0.0)
        mimics.append(Mimic(joint, leader, coefficients[1], offset))
    notes = (
        [f"constraints are ignored unless one joint follows another linearly: {list_names(others)}"] if others else []
    )
    tendons = [tendon.get("name", tendon.tag) for section in root.findall("tendon") for tendon in section]
    if tendons:
        notes.append(f"tendons are ignored ({list_names(tendons)})")
    return tuple(mimics), notes


def read_closures(root: Element) -> tuple[Closure, ...]:
    """The constraints that hold two bodies together; not those to a mocap body, which a user of MuJoCo moves."""
    moved_by_hand = {body.get("name") for body in root.iter("body") if body.get("mocap") == "true"}
    found = []
    for element in [constraint for section in root.findall("equality") for constraint in section]:
        bodies = element.get("body1"), element.get("body2", "world")
        if element.tag not in ("connect", "weld") or bodies[0] is None or not _acts(element):
            continue
        if not moved_by_hand & set(bodies):
            name = element.get("name") or f"{element.tag} of {bodies[0]} and {bodies[1]}"
            found.append(Closure(name, bodies[0], bodies[1]))
    return tuple(found)


def _acts(constraint: Element) -> bool:
    return constraint.get("active", "true") != "false"
