"""Joints that do not move: where a scenario holds them, and what follows them."""

from collections.abc import Mapping, Sequence

from pydrake.multibody.plant import MultibodyPlant

from drake_cafim.description.description import ModelStatements
from drake_cafim.dynamics.tree import Tree
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import UNRECORDED


def held(
    lock: Mapping[str, float] | Sequence[str] | str, plant: MultibodyPlant, said: ModelStatements
) -> dict[str, float] | str:
    """`lock:` with a position (rad, m) for each joint, those that follow a held joint included.

    Of a list each joint stands at the file's value, 0 where it has none. `unrecorded` stays, until recordings are
    known. Raises `InputError` for a joint that the model lacks.
    """
    if isinstance(lock, str):
        return lock
    given = dict(lock) if isinstance(lock, Mapping) else {name: _own(name, plant, said) for name in lock}
    waiting = list(said.mimics)
    while found := [one for one in waiting if one.leader in given]:
        for one in found:
            given.setdefault(one.joint, one.multiplier * given[one.leader] + one.offset)
        waiting = [one for one in waiting if one not in found]
    return given


def _own(name: str, plant: MultibodyPlant, said: ModelStatements) -> float:
    """The joint's position in the pose that the file draws."""
    if not plant.HasJointNamed(name):
        names = ", ".join(plant.get_joint(i).name() for i in plant.GetJointIndices())
        raise InputError(f"lock names the joint {name!r}, which the model lacks; it has: {names}")
    default = plant.GetJointByName(name).default_positions()
    return said.positions.get(name, float(default[0]) if len(default) == 1 else 0.0)


def positions(lock: Mapping[str, float] | Sequence[str] | str) -> dict[str, float]:
    """Where the joints of a `lock:` that `held` has seen are held."""
    return dict(lock) if isinstance(lock, Mapping) else {}


def check_coupled(tree: Tree, said: ModelStatements) -> None:
    """Raises `InputError` for a joint that follows another one and is not held."""
    for one in said.mimics:
        if one.joint in tree.joint_names and one.leader in tree.joint_names:
            place = said.places.get(one.joint, "the model")
            raise InputError(
                f"{place}: joint {one.joint!r} follows {one.leader!r}, and what follows a joint that moves is not "
                f"supported; expected `lock: [{one.leader}]` in the scenario, which holds both"
            )


def hint(recording: Recording, joints: Sequence[str]) -> str:
    """What to do about joints that a recording lacks."""
    names = f"{', '.join(joints[:6])}{', ...' if len(joints) > 6 else ''}"
    return (
        f"{recording.name}: there is no column q.{joints[0]}; it has {', '.join(recording.columns)}. A joint that was "
        f"not recorded is held by `lock: [{names}]` in the scenario (with {{joint: position}} where it does not stand "
        f"at the file's), and all of them by `lock: {UNRECORDED}`"
    )
