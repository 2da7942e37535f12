"""The position servos of a scenario: from `servo:` and the model's actuators to one servo a joint."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.description.description import StatedServo
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.servo import Servo
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import ServoEntry

SERVO_PARAMETERS = {
    "servo_stiffness": "N m/rad",
    "servo_damping": "N m s/rad",
    "servo_limit": "N m",
}
"""Names in `unknown:` with their units at a revolute joint; where kp is a column, `servo_stiffness` is its scale."""
FIELDS = {"servo_stiffness": "stiffness", "servo_damping": "damping", "servo_limit": "limit"}


def servos_of(
    entry: ServoEntry | None, stated: Sequence[StatedServo], tree: Tree, locked: Sequence[str], source: str
) -> tuple[Servo, ...]:
    """The servo of each joint of `tree` that has one: of the scenario's `entry`, else `stated` by the model's file.

    Names of `locked` joints are allowed and have no servo. Raises `InputError` for a joint that the model lacks.
    """
    names = tree.joint_names
    of_model = {
        servo.joint: Servo(servo.joint, servo.stiffness, servo.damping, servo.limit)
        for servo in stated
        if servo.joint in names
    }
    if entry is None:
        return tuple(of_model[name] for name in names if name in of_model)
    for key, values in (("kp", entry.kp), ("kv", entry.kv), ("limit", entry.limit)):
        for name in values:
            if name not in ("all", "column", "scale", *names, *locked):
                raise InputError(
                    f"{source}: servo.{key} names the joint {name!r}, which the model lacks; it has: {', '.join(names)}"
                )
    found = []
    for name in names:
        servo = _servo(entry, name, of_model.get(name))
        if servo is not None:
            found.append(servo)
    return tuple(found)


def _servo(entry: ServoEntry, name: str, of_model: Servo | None) -> Servo | None:
    """The joint's servo; None where neither the entry nor the model states a stiffness for it."""
    column = str(entry.kp["column"]) if "column" in entry.kp else None
    stiffness = float(entry.kp["scale"]) if column else _value(entry.kp, name)
    if stiffness is None and of_model is None:
        return None
    servo = of_model or Servo(name, 0.0)
    if stiffness is not None:
        servo = replace(servo, stiffness=stiffness, column=column)
    damping, limit = _value(entry.kv, name), _value(entry.limit, name)
    if damping is not None:
        servo = replace(servo, damping=damping)
    if limit is not None:
        servo = replace(servo, limit=limit)
    if entry.supply is not None:
        servo = replace(servo, supply=entry.supply.column, nominal_supply=entry.supply.nominal)
    return servo


def _value(values: Mapping[str, float | str], name: str) -> float | None:
    found = values.get(name, values.get("all"))
    return None if found is None else float(found)


def servo_parameters(servos: Sequence[Servo], joint: str) -> dict[str, float]:
    """The values of a joint's servo by the name in `unknown:`; empty for a joint without a servo."""
    for servo in servos:
        if servo.joint == joint:
            values = {name: float(getattr(servo, field)) for name, field in FIELDS.items()}
            return {name: value if np.isfinite(value) else np.nan for name, value in values.items()}
    return {}


def with_servo_parameter(servos: Sequence[Servo], joint: str, parameter: str, value: float) -> tuple[Servo, ...]:
    """The servos with one of `SERVO_PARAMETERS` of a joint at `value`."""
    return tuple(
        replace(servo, **{FIELDS[parameter]: value}) if servo.joint == joint else servo  # type: ignore[arg-type]
        for servo in servos
    )
