"""What of a model and of a scenario's file is supported: an error for the rest, or a note."""

from pydrake.multibody.plant import MultibodyPlant

from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import OF_HARDWARE_SIM, Scenario


def notes_on_unused(scenario: Scenario) -> list[str]:
    """A note on keys of Drake's hardware_sim that say what a recording says already."""
    given = [key for key in OF_HARDWARE_SIM if getattr(scenario, key)]
    return [f"not used of the scenario: {', '.join(given)}; efforts are those at the joints"] if given else []


def check_supported(plant: MultibodyPlant, name: str) -> None:
    """Raises `InputError` for a floating body with joints, and for constraints between bodies."""
    free = plant.GetFloatingBaseBodies()
    for body in [plant.get_body(index) for index in free]:
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(body.model_instance())]
        if any(joint.num_velocities() > 0 and joint.child_body().index() not in free for joint in joints):
            raise InputError(
                f"{name}: nothing holds {body.name()}, which carries the joints, and a floating base with joints is "
                f"not supported; expected it under `weld: [{{body: {body.name()}}}]` of a scenario if it stands still"
            )
    if plant.num_constraints() > 0:
        raise InputError(
            f"{name}: constraints of the model close a chain of joints, and closed chains are not supported"
        )
