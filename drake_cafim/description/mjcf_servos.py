"""Reading of an MJCF's position servos: the stiffness and damping of `position`, `velocity` and affine actuators.

A position actuator makes the joint's effort gear·clip(kp (ctrl − gear·q) − kv·gear·v, forcerange). The command is that
of the joint, ctrl/gear; the force range limits the whole, and is read as the joint's effort limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from drake_cafim.description.description import StatedEffect, StatedServo, list_names
from drake_cafim.description.xml_document import numbers


@dataclass(frozen=True)
class StatedServos:
    """The `servos` of joints, the lags of their commands (`acting`), and `notes` on what is not read."""

    servos: tuple[StatedServo, ...]
    acting: tuple[StatedEffect, ...]
    notes: tuple[str, ...]


def read_servos(found: Sequence[Element]) -> StatedServos:
    """The position servos among the actuators `found`, which hold the attributes of their classes."""
    stiffness: dict[str, float] = {}
    damping: dict[str, float] = {}
    lags: dict[str, float] = {}
    geared, rated, other = [], [], []
    for element in found:
        joint, name = element.get("joint"), str(element.get("name") or element.get("joint"))
        gains = _gains(element)
        if joint is None or gains is None:
            continue
        gear = numbers(element, "gear", "1")[0]
        kp, kv = gains
        if kp > 0.0:
            stiffness[joint] = stiffness.get(joint, 0.0) + kp * gear**2
            lag = _number(element, "timeconst")
            lags |= {joint: lag} if lag > 0.0 else {}
            geared += [name] if gear != 1.0 else []
            rated += [name] if element.get("dampratio") else []
        damping[joint] = damping.get(joint, 0.0) + kv * gear**2
        other += [name] if kp == 0.0 else []
    notes = []
    alone = [joint for joint in damping if joint not in stiffness]
    if alone:
        notes.append(f"actuators that follow a velocity are not read as servos ({list_names(alone)})")
    beside = [name for name in other if name not in alone]
    if beside:
        notes.append(f"velocity actuators beside a position servo damp as if 0 were commanded ({list_names(beside)})")
    if geared:
        notes.append(f"commands to geared servos are the joint's: ctrl/gear ({list_names(geared)})")
    if rated:
        notes.append(f"dampratio of servos is not read: give kv under `servo:` ({list_names(rated)})")
    servos = tuple(StatedServo(joint, kp, damping[joint], float("inf")) for joint, kp in stiffness.items())
    acting = tuple(StatedEffect("command_lag", joint, {"time_constant": lag}) for joint, lag in lags.items())
    return StatedServos(servos, acting, tuple(notes))


def _gains(element: Element) -> tuple[float, float] | None:
    """kp and kv of an actuator, at its own side of the gear; None where it is no servo."""
    if element.tag == "position":
        return _number(element, "kp", 1.0), _number(element, "kv")
    if element.tag == "velocity":
        return 0.0, _number(element, "kv", 1.0)
    if element.tag != "general" or element.get("biastype") != "affine":
        return None
    gain, bias = numbers(element, "gainprm", "1")[0], [*numbers(element, "biasprm", "0"), 0.0, 0.0, 0.0]
    # gain·ctrl + bias₀ + bias₁ q + bias₂ v
    position = gain > 0.0 and bias[0] == 0.0 and abs(gain + bias[1]) <= 1e-9 * gain
    return (gain, -bias[2]) if position else None


def _number(element: Element, key: str, default: float = 0.0) -> float:
    return float(numbers(element, key, str(default))[0])
