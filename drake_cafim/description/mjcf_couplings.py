"""An MJCF's constraints between joints."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from drake_cafim.description.description import Mimic, listed
from drake_cafim.description.xml_document import numbers


def couplings(root: Element, references: Mapping[str, float]) -> tuple[tuple[Mimic, ...], list[str]]:
    """Joints that follow another one in proportion, and notes on the constraints that are not taken.

    `<equality joint>` says q₁ − ref₁ = a₀ + a₁ (q₂ − ref₂); `references` (rad, m) by joint.
    """
    mimics, others = [], []
    for element in [one for section in root.findall("equality") for one in section]:
        if element.get("active", "true") == "false":
            continue
        coefficients = (numbers(element, "polycoef") or [0.0, 1.0]) + [0.0, 0.0]
        joint, leader = element.get("joint1"), element.get("joint2")
        if element.tag != "joint" or not joint or not leader or any(coefficients[2:]):
            others.append(element.get("name") or f"{element.tag} of {element.get('body1') or joint or 'tendons'}")
            continue
        offset = references.get(joint, 0.0) + coefficients[0] - coefficients[1] * references.get(leader, 0.0)
        mimics.append(Mimic(joint, leader, coefficients[1], offset))
    notes = (
        [f"constraints that are not taken, since no joint follows another by them: {listed(others)}"] if others else []
    )
    tendons = [one.get("name", one.tag) for section in root.findall("tendon") for one in section]
    if tendons:
        notes.append(f"tendons are not taken ({listed(tendons)})")
    return tuple(mimics), notes
