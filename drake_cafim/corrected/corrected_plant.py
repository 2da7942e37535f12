"""What a scene becomes in a Diagram."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import InputPort, OutputPort


@dataclass(frozen=True)
class CorrectedPlant:
    """A scene's plant in a builder with its effects around it, and where a controller connects.

    `effort` (n,) N m or N is what is asked of the joints' actuators, in the order of `joints`: a command goes in here
    and not into the plant's actuation ports, which know of no effect. `measured` are the recording's channels as the
    scene's sensors show them, without noise: "q", "v", "u" (n,), "wrench.<sensor>" (6,), "pose.<body>" (7,);
    "channels" is all of them, one after the other, as `columns` names them.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    joints: tuple[str, ...]
    effort: InputPort
    measured: Mapping[str, OutputPort]
    columns: tuple[str, ...]
