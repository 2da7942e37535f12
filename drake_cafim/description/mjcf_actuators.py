"""What an MJCF's actuators say of the efforts at joints."""

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from drake_cafim.description.description import listed
from drake_cafim.description.mjcf_defaults import Defaults
from drake_cafim.description.mjcf_frames import Compiler, limited
from drake_cafim.description.xml_document import numbers

SERVOS = ("position", "velocity", "intvelocity", "damper")


def actuators(root: Element, defaults: Defaults) -> list[Element]:
    """All actuators, their classes written out."""
    found = [element for section in root.findall("actuator") for element in section]
    for element in found:
        defaults.write_out(element, None, also=("general",))
    return found


def effort_limits(
    found: Sequence[Element], worlds: Sequence[Element], compiler: Compiler
) -> tuple[dict[str, float], list[str]]:
    """The largest effort at each joint that is limited, N m or N, and notes on what is not taken.

    An actuator's force times its gear acts at the joint; the forces of several add up.
    """
    limits: dict[str, float] = {}
    for element in found:
        joint = element.get("joint")
        if joint:
            limits[joint] = limits.get(joint, 0.0) + _largest(element, compiler)
    for name, effort in _of_joints(worlds, compiler):
        limits[name] = min(effort, limits.get(name, np.inf))
    servos = [str(one.get("name") or one.get("joint")) for one in found if one.tag in SERVOS]
    others = [one.get("name", one.tag) for one in found if not one.get("joint")]
    notes = []
    if servos:
        notes.append(
            f"gains of the model's servos are not taken, `servo:` in the scenario gives them ({listed(servos)})"
        )
    if others:
        notes.append(f"actuators that drive no single joint are not taken ({listed(others)})")
    return {name: value for name, value in limits.items() if 0.0 < value < np.inf}, notes


def _largest(element: Element, compiler: Compiler) -> float:
    """N m or N at the joint."""
    gear = abs(numbers(element, "gear", "1")[0])
    force = limited(element, "forcelimited", "forcerange", compiler)
    control = limited(element, "ctrllimited", "ctrlrange", compiler) if element.tag == "motor" else []
    return gear * min([float(np.max(np.abs(span))) for span in (force, control) if span], default=np.inf)


def _of_joints(worlds: Sequence[Element], compiler: Compiler) -> Iterator[tuple[str, float]]:
    for world in worlds:
        for joint in world.iter("joint"):
            span = numbers(joint, "actuatorfrcrange")
            if len(span) == 2 and joint.get("actuatorfrclimited", "auto") != "false":
                yield joint.get("name", ""), float(np.max(np.abs(span)))
