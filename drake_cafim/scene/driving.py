"""What drives each joint in a recording: its recorded effort, or its position servo by the recorded command."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording, listed
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

RAMPED = "first_order"
"""The `hold` of a channel whose values are linear from sample to sample."""


@dataclass(frozen=True)
class Command:
    """What a joint's servo gets in one recording, (N,) each, missing samples as NaN.

    `position` is the command, rad or m; `gain` the column that kp is a multiple of, else 1; `supply` the supply voltage
    over its nominal, else 1. `ramped`: whether the command is linear between samples; else each is held.
    """

    position: Array
    gain: Array
    supply: Array
    ramped: bool = False

    def over(self, time: Array) -> Effort:
        """The commanded position over time, for samples at `time` (N,) s."""
        return Effort(time, self.position, self.ramped)


def driven_by_servo(scene: Scene, recording: Recording) -> tuple[str, ...]:
    """The joints that a servo drives in the recording: those with a `cmd.` column that no `u.` column stands against.

    Raises `InputError` for a joint with a servo that the recording has neither column of.
    """
    entry = scene.scenario.servo
    always = entry is not None and entry.drive == "servo"
    found = []
    for servo in scene.physics.servos:
        commanded, pushed = (f"{kind}.{servo.joint}" in recording.columns for kind in ("cmd", "u"))
        if commanded and (always or not pushed):
            found.append(servo.joint)
        elif not pushed and f"q.{servo.joint}" in recording.columns:
            raise InputError(
                f"{recording.name}: there is no column cmd.{servo.joint} and no column u.{servo.joint}; expected the "
                f"commanded position for the joint's servo, or its effort; it has {listed(recording.columns)}"
            )
    return tuple(found)


def columns_of_servos(scene: Scene) -> frozenset[str]:
    """The columns beside those of joints that the servos read: their gains and supplies."""
    read = [name for servo in scene.physics.servos for name in (servo.column, servo.supply)]
    return frozenset(name for name in read if name is not None)


def undriven(scene: Scene, recording: Recording) -> tuple[str, ...]:
    """The joints without a column of efforts that nothing drives, by the model's files.

    These state an actuator, a servo or an effort limit at some joint, and none of them at this one.
    """
    plant, joints = scene.plant, scene.tree.joints
    driven = {plant.get_joint_actuator(i).joint().name() for i in plant.GetJointActuatorIndices()}
    driven |= {*scene.stated.driven, *(servo.joint for servo in scene.physics.servos)}
    driven |= {joint.name for joint in joints if 0.0 < joint.effort_limit < np.inf}
    if not driven & {joint.name for joint in joints}:
        return ()
    return tuple(
        joint.name for joint in joints if joint.name not in driven and f"u.{joint.name}" not in recording.columns
    )


def idle_joints(scene: Scene, recording: Recording) -> tuple[str, ...]:
    """The joints whose effort in the recording is 0 but for a servo's: those that a servo or nothing drives."""
    return (*driven_by_servo(scene, recording), *undriven(scene, recording))


def with_idle_efforts(scene: Scene, recording: Recording) -> Recording:
    """The recording with efforts 0 at the idle joints: what acts beside the servos.

    Raises `InputError` for a joint without a column of efforts that the model's files do not say is undriven.
    """
    zeros = np.zeros(len(recording))
    columns = {**recording.columns, **{f"u.{name}": zeros for name in idle_joints(scene, recording)}}
    lacking = [name for name in scene.tree.joint_names if f"u.{name}" not in columns]
    if lacking and f"q.{lacking[0]}" in columns:
        raise InputError(
            f"{recording.name}: there is no column u.{lacking[0]}; expected the effort at that joint, zeros where "
            f"nothing drives it; it has {listed(recording.columns)}"
        )
    return replace(recording, columns=columns)


def commands_of(scene: Scene, recording: Recording, driven: Sequence[str]) -> dict[int, Command]:
    """The command of each of the `driven` joints, by the joint's index in the tree.

    Raises `InputError` where a column is missing that the servo needs.
    """
    found = {}
    for servo in scene.physics.servos:
        if servo.joint not in driven:
            continue
        channel = scene.channel(f"cmd.{servo.joint}")
        ones = np.ones(len(recording))
        found[scene.tree.joint_index(servo.joint)] = Command(
            recording.measured(f"cmd.{servo.joint}"),
            ones if servo.column is None else recording.measured(servo.column),
            ones if servo.supply is None else recording.measured(servo.supply) / servo.nominal_supply,
            channel is not None and channel.hold == RAMPED,
        )
    return found
