"""Functions that the four worlds share: their kinds of contact, their output ports, and the start of an experiment."""

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
    """The true parameters by name: `defaults`, replaced by the values of `truth`.

    Raises `InputError` for a name that is not in `defaults`, and for a value that is not positive.
    """
    unknown = sorted(set(truth) - set(defaults))
    if unknown:
        raise InputError(f"{scenario}: the truth names {', '.join(unknown)}, expected {', '.join(defaults)}")
    for name, value in truth.items():
        if not value > 0:
            raise InputError(f"{scenario}: the true {name} is {value}, expected a positive number")
    return {**defaults, **truth}


def export_force(builder: DiagramBuilder, force: OutputPort, *, std: list[float], period: float, seed: int) -> None:
    """Exports the noiseless `force` as `true_force`, and with noise of `std` as `measured_force`."""
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
    """Adds a `ToolState` of the point T of `body`, and exports its output as `measured_state`."""
    state = ToolState(body=body.index(), p_BT=p_BT, axes=axes, origin=origin)
    builder.AddNamedSystem("tool_state", state)
    builder.Connect(plant.get_body_poses_output_port(), state.GetInputPort("body_poses"))
    builder.Connect(plant.get_body_spatial_velocities_output_port(), state.GetInputPort("body_spatial_velocities"))
    builder.ExportOutput(state.get_output_port(), "measured_state")
    return state


def export_joints(
    builder: DiagramBuilder, plant: MultibodyPlant, robot: ModelInstanceIndex, concealed: AffectedRobot
) -> None:
    """Exports `joint_state`, positions then velocities, and `joint_effort`, the net actuation at the joints.

    The effort is the one that the plant's last step applied, within the limits: it belongs to the sample before. The
    state includes concealed sensor effects.
    """
    builder.ExportOutput(concealed.measured(builder, plant, plant.get_state_output_port(robot)), "joint_state")
    builder.ExportOutput(plant.get_net_actuation_output_port(robot), "joint_effort")


def start_context(diagram: Diagram, experiment: int = 0) -> Context:
    """A Context at time 0 in the start state; `experiment` chooses the noise that its sensor will have."""
    context = diagram.CreateDefaultContext()
    noise = diagram.GetSubsystemByName(NOISE)
    # by the Diagram, not from the root: it may have become part of another Diagram
    noise_context = diagram.GetMutableSubsystemContext(noise, context)
    noise_context.get_mutable_numeric_parameter(0)[0] = float(experiment)
    return context
