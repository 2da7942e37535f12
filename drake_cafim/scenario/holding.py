"""Locked joints: the positions at which `lock:` holds them, and the joints that follow them."""

from collections.abc import Mapping, Sequence

from pydrake.multibody.plant import MultibodyPlant

from drake_cafim.description.description import ModelStatements, list_names
from drake_cafim.dynamics.tree import FIXED, Tree
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording, listed
from drake_cafim.scenario.schema import UNRECORDED


def resolve_lock(
    lock: Mapping[str, float] | Sequence[str] | str, plant: MultibodyPlant, statements: ModelStatements
) -> dict[str, float] | str:
    """`lock:` as a position (rad, m) for each locked joint and for each joint that follows one.

    Joints that are given without a position are at that of the model file, or 0. The word `unrecorded` is returned
    as it is: its joints depend on the recordings. Raises `InputError` for a joint that the model lacks.
    """
    if isinstance(lock, str):
        return lock
    given = (
        dict(lock) if isinstance(lock, Mapping) else {name: _default_position(name, plant, statements) for name in lock}
    )
    waiting = list(statements.mimics)
    # repeated, since a joint may follow one that itself follows another
    while found := [mimic for mimic in waiting if mimic.leader in given]:
        for mimic in found:
            given.setdefault(mimic.joint, mimic.multiplier * given[mimic.leader] + mimic.offset)
        waiting = [mimic for mimic in waiting if mimic not in found]
    return given


def _default_position(name: str, plant: MultibodyPlant, statements: ModelStatements) -> float:
    """The joint's position in the model file's reference pose."""
    if not plant.HasJointNamed(name):
        names = ", ".join(plant.get_joint(i).name() for i in plant.GetJointIndices())
        raise InputError(f"lock names the joint {name!r}, which the model lacks; it has: {names}")
    default = plant.GetJointByName(name).default_positions()
    return statements.positions.get(name, float(default[0]) if len(default) == 1 else 0.0)


def locked_positions(lock: Mapping[str, float] | Sequence[str] | str) -> dict[str, float]:
    """The positions in a `lock:` that `resolve_lock` returned; empty for `unrecorded`."""
    return dict(lock) if isinstance(lock, Mapping) else {}


def followed_joints(statements: ModelStatements) -> dict[str, tuple[str, float, float]]:
    """Leader, multiplier and offset (rad, m) of each joint that follows another one."""
    return {mimic.joint: (mimic.leader, mimic.multiplier, mimic.offset) for mimic in statements.mimics}


def notes_on_followers(tree: Tree) -> tuple[str, ...]:
    """A note that says which joints follow which, and that their own columns are not used."""
    if not tree.followers:
        return ()
    pairs = [
        f"{item.joint.name} = {item.multiplier:g} {tree.joints[item.leader].name}"
        + (f" + {item.offset:g}" if item.offset else "")
        for item in tree.followers
    ]
    return (f"joints that follow others move with them, and their own columns are not used ({list_names(pairs)})",)


def check_mimics(tree: Tree, statements: ModelStatements) -> None:
    """Raises `InputError` for a joint that follows another one and carries joints that follow none."""
    for mimic in statements.mimics:
        if mimic.joint in tree.joint_names and mimic.leader in tree.joint_names:
            place = statements.places.get(mimic.joint, "the model")
            raise InputError(
                f"{place}: joint {mimic.joint!r} follows {mimic.leader!r} and carries joints that follow none, which "
                f"is not supported; expected `lock: [{mimic.leader}]` in the scenario, which holds both"
            )


def check_closures(tree: Tree, statements: ModelStatements, source: str) -> None:
    """Raises `InputError` for a constraint by which a chain of joints that move closes."""
    riding = {body.name: body.joint for body in tree.bodies} | {"world": FIXED}
    for closure in statements.closures:
        if riding.get(closure.body, FIXED) != riding.get(closure.other, FIXED):
            raise InputError(
                f"{source}: the constraint {closure.name} closes a chain of joints, and closed chains are not "
                f"supported; hold the joints between {closure.body} and {closure.other} by `lock:`, or take the "
                "constraint out of the model file if it does not act"
            )


def explain_missing_joints(recording: Recording, joints: Sequence[str]) -> str:
    """The message for `joints` that the recording has no column of: what it has, and how to lock them."""
    names = f"{', '.join(joints[:6])}{', ...' if len(joints) > 6 else ''}"
    return (
        f"{recording.name}: there is no column q.{joints[0]}; it has {listed(recording.columns)}. A joint that was "
        f"not recorded is held by `lock: [{names}]` in the scenario (or `lock: {{joint: position}}` where it is not at "
        f"the model file's), and all of them by `lock: {UNRECORDED}`"
    )
