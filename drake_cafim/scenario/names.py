"""Check of the names in a scenario against its model."""

from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.multibody.plant import MultibodyPlant

from drake_cafim.dynamics.tree import Tree
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import UNRECORDED, Scenario


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put the file's name `source` before the messages of `InputError`s that are raised within the block."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(f"{source}:") else f"{source}: {text}") from None


def check_names(scenario: Scenario, plant: MultibodyPlant, tree: Tree) -> None:
    """Raises `InputError` for a joint, body or contact that the model lacks, and for a robot without a moving joint."""
    if not tree.joints and not tree.floating and scenario.lock != UNRECORDED:
        locked = ", ".join(scenario.lock)
        why = f"all of them are under lock ({locked})" if locked else "it has none"
        raise InputError(f"no joint of the model moves, {why}; expected at least one")
    bodies = [body.name for body in tree.bodies]
    joints = [plant.get_joint(i).name() for i in plant.GetJointIndices()]
    for name, channel in scenario.channels.items():
        kind, _, place = name.partition(".")
        if kind == "pose":
            _check(place, bodies, f"channels.{name}", "body")
        elif kind == "wrench":
            _check(channel.body, bodies, f"channels.{name}.body", "body")
        elif place:
            _check(place, joints, f"channels.{name}", "joint")
    for i, name in enumerate(scenario.unlimited):
        _check(name, joints, f"unlimited[{i}]", "joint")
    for i, pair in enumerate(scenario.contact):
        # `ground` names a half-space that the model does not have
        for k, body in enumerate(pair.bodies):
            if pair.ground is None:
                _check(body, [*bodies, "world"], f"contact[{i}].bodies[{k}]", "body")
        if any(set(other.bodies) == set(pair.bodies) for other in scenario.contact[:i]):
            raise InputError(f"contact[{i}] is of {'/'.join(pair.bodies)} a second time")


def _check(name: str, valid: list[str], key: str, what: str) -> None:
    if name not in valid:
        found = f"names the {what} {name!r}, which the model lacks" if name else f"is empty, expected a {what}"
        raise InputError(f"{key} {found}; it has: {', '.join(valid)}")
