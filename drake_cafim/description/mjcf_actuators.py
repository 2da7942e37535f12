"""Reading of an MJCF's actuators: the effort limits of joints."""

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from drake_cafim.description.description import list_names
from drake_cafim.description.mjcf_defaults import Defaults
from drake_cafim.description.mjcf_frames import Compiler, binding_range
from drake_cafim.description.xml_document import numbers

UNREAD = ("intvelocity", "damper")


def read_actuators(root: Element, defaults: Defaults) -> list[Element]:
    """All actuators of the file, with the attributes of their default classes."""
    found = [element for section in root.findall("actuator") for element in section]
    for element in found:
        defaults.write_out(element, None, also=("general",))
    return found


def effort_limits(
    found: Sequence[Element], worlds: Sequence[Element], compiler: Compiler
) -> tuple[dict[str, float], list[str]]:
    """The largest effort (N m or N) of each joint that has a limit, and notes on what is ignored.

    At a joint act the forces of all its actuators, each times its gear; their limits add up, and the joint's own
    `actuatorfrcrange` limits the sum.
    """
    limits: dict[str, float] = {}
    for element in found:
        joint = element.get("joint")
        if joint:
            limits[joint] = limits.get(joint, 0.0) + _largest(element, compiler)
    for name, effort in _of_joints(worlds, compiler):
        limits[name] = min(effort, limits.get(name, np.inf))
    unread = [str(actuator.get("name") or actuator.get("joint")) for actuator in found if actuator.tag in UNREAD]
    others = [actuator.get("name", actuator.tag) for actuator in found if not actuator.get("joint")]
    notes = []
    if unread:
        notes.append(f"actuators of type {' or '.join(UNREAD)} are ignored ({list_names(unread)})")
    if others:
        notes.append(f"actuators that do not drive a single joint are ignored ({list_names(others)})")
    return {name: value for name, value in limits.items() if 0.0 < value < np.inf}, notes


def driven_joints(found: Sequence[Element], worlds: Sequence[Element]) -> tuple[str, ...]:
    """The joints that the actuators drive: each where one drives more than a joint, as by a tendon."""
    if all(actuator.get("joint") for actuator in found):
        return tuple(dict.fromkeys(str(actuator.get("joint")) for actuator in found))
    return tuple(str(joint.get("name")) for world in worlds for joint in world.iter("joint"))


def _largest(element: Element, compiler: Compiler) -> float:
    """The actuator's largest effort at the joint, gear · force, N m or N; infinite where nothing limits it."""
    gear = abs(numbers(element, "gear", "1")[0])
    force = binding_range(element, "forcelimited", "forcerange", compiler)
    control = binding_range(element, "ctrllimited", "ctrlrange", compiler) if element.tag == "motor" else []
    return gear * min([float(np.max(np.abs(span))) for span in (force, control) if span], default=np.inf)


def _of_joints(worlds: Sequence[Element], compiler: Compiler) -> Iterator[tuple[str, float]]:
    """Name and limit (N m or N) of each joint with an active `actuatorfrcrange`."""
    for world in worlds:
        for joint in world.iter("joint"):
            span = numbers(joint, "actuatorfrcrange")
            if len(span) == 2 and joint.get("actuatorfrclimited", "auto") != "false":
                yield joint.get("name", ""), float(np.max(np.abs(span)))
