"""What the four worlds have in common: two kinds of contact, named ports, a fresh start for each experiment."""

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort

from drake_cafim.corrected.world import AffectedRobot
from drake_cafim.diagrams.sensing import SensorNoise, ToolState
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

WorldKind: TypeAlias = Literal["drake", "model"]
"""`drake`: Drake's hydroelastic or compliant contact; `model`: the planner's own law as a force element."""

NOISE = "noise"
"""Name of the system that adds the noise of the force sensor."""


def check_kind(world: str) -> None:
    """Raises `InputError` unless `world` is one of `WorldKind`."""
    if world not in get_args(WorldKind):
        raise InputError(f"world {world!r}: expected one of {', '.join(get_args(WorldKind))}")


def check_truth(scenario: str, defaults: Mapping[str, float], truth: Mapping[str, float]) -> dict[str, float]:
    """The true parameters by name, `defaults` where `truth` is silent.

    Raises `InputError` on a name that is none of the scenario's, and on a value that is not positive.
    """
    unknown = sorted(set(truth) - set(defaults))
    if unknown:
        raise InputError(f"{scenario}: the truth names {', '.join(unknown)}, expected {', '.join(defaults)}")
    for name, value in truth.items():
        if not value > 0:
            raise InputError(f"{scenario}: the true {name} is {value}, expected a positive number")
    return {**defaults, **truth}


def export_force(builder: DiagramBuilder, force: OutputPort, *, std: list[float], period: float, seed: int) -> None:
    """Outputs `true_force` and `measured_force` of the Diagram for the noiseless signal `force`."""
    noise = builder.AddNamedSystem(NOISE, SensorNoise(std=std, period=period, seed=seed))
    builder.Connect(force, noise.get_input_port())
    builder.ExportOutput(force, "true_force")
    builder.ExportOutput(noise.get_output_port(), "measured_force")


def export_tool_state(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    body: RigidBody,
    *,
    p_BT: Array,
    axes: Array,
    origin: Array | None = None,
) -> ToolState:
    """Output `measured_state` of the Diagram: motion of the point T of `body`, as `ToolState` has it."""
    state = ToolState(body=body.index(), p_BT=p_BT, axes=axes, origin=origin)
    builder.AddNamedSystem("tool_state", state)
    builder.Connect(plant.get_body_poses_output_port(), state.GetInputPort("body_poses"))
    builder.Connect(plant.get_body_spatial_velocities_output_port(), state.GetInputPort("body_spatial_velocities"))
    builder.ExportOutput(state.get_output_port(), "measured_state")
    return state


def export_joints(
    builder: DiagramBuilder, plant: MultibodyPlant, robot: ModelInstanceIndex, concealed: AffectedRobot
) -> None:
    """Outputs `joint_state`, positions then velocities, and `joint_effort`, what acts at the joints, of the Diagram.

    The effort is what the last step of the plant applied, within the limits: it belongs to the sample before. The
    state is what the joints' sensors write of it.
    """
    builder.ExportOutput(concealed.measured(builder, plant, plant.get_state_output_port(robot)), "joint_state")
    builder.ExportOutput(plant.get_net_actuation_output_port(robot), "joint_effort")


def start_context(diagram: Diagram, experiment: int = 0) -> Context:
    """A Context at time 0 in the start state; `experiment` chooses the noise that its sensor will have."""
    context = diagram.CreateDefaultContext()
    noise = diagram.GetSubsystemByName(NOISE)
    # relative to this Diagram, which may by now be a part of another
    noise_context = diagram.GetMutableSubsystemContext(noise, context)
    noise_context.get_mutable_numeric_parameter(0)[0] = float(experiment)
    return context
