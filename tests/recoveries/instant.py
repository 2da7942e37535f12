"""Accelerations and readings of a scene in Drake at a given state."""

from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from drake_cafim.corrected.corrected_plant import CorrectedPlant
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

from .rig import CONTINUOUS

NOW = 0.3
"""s"""


def built(
    scene: Scene, config: MultibodyPlantConfig = CONTINUOUS, **more: Any
) -> tuple[CorrectedPlant, Diagram, Context]:
    """The scene alone in a Diagram with the input `effort`."""
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, config, **more)
    builder.ExportInput(corrected.effort, "effort")
    diagram = builder.Build()
    return corrected, diagram, diagram.CreateDefaultContext()


def entry(name: str, at: str, values: dict[str, Any]) -> dict[str, Any]:
    return {"effect": name, "at": at, **values}


def drake_acceleration(scene: Scene, q: Array, v: Array, u: Array, config: MultibodyPlantConfig, **more: Any) -> Array:
    corrected, diagram, context = built(scene, config, **more)
    context.SetTime(NOW)
    diagram.GetInputPort("effort").FixValue(context, u)
    own = corrected.plant.GetMyMutableContextFromRoot(context)
    corrected.plant.SetPositions(own, q)
    corrected.plant.SetVelocities(own, v)
    if config.time_step == 0.0:
        return np.array(diagram.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector())
    updated = corrected.plant.EvalUniquePeriodicDiscreteUpdate(own).value()
    return np.asarray((updated[len(q) :] - v) / config.time_step)
