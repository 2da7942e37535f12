"""The result of adding a scene to a Diagram: its plant, its ports and its channels."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import InputPort, OutputPort


@dataclass(frozen=True)
class CorrectedPlant:
    """A scene's plant in a builder, with systems for its effects, and the ports that a controller connects to.

    `effort` (n,) N m or N is the command of the joints' actuators, in the order of `joints`: connect a command here
    and not to the plant's actuation ports, which bypass the actuator effects. `measured` are the recording's channels
    with the sensor effects and without noise: "q", "v", "u" (n,), "wrench.<sensor>" (6,), "pose.<body>" (7,);
    "channels" is their concatenation, in the order of `columns`. A floating body has no joints: its `effort` is
    (0,), and its poses alone are measured; `plant.SetFreeBodyPose` and `plant.SetFreeBodySpatialVelocity` throw it.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    joints: tuple[str, ...]
    effort: InputPort
    measured: Mapping[str, OutputPort]
    columns: tuple[str, ...]
    servo: Mapping[str, InputPort] = field(default_factory=dict)
    """Where joints have position servos, ports (n,): "command" rad or m, "gain" and "supply" as `ServoSystem` reads
    them. Without a connected command the servos are switched off; `effort` acts beside them and need not be connected.
    """
