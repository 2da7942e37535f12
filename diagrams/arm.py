"""Adds the seven-joint arm to a plant, and builds the plant by which its controller computes inverse dynamics."""

from collections.abc import Sequence

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex, SpatialInertia

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.models import PACKAGE, add_to_package_map
from drake_cafim.typing import Array

TOOL = "tool"
"""Name of the frame of the control plant whose motion is commanded."""


def add_model(plant: MultibodyPlant, name: str) -> ModelInstanceIndex:
    """Instance of package://drake_cafim_models/<name>.urdf, added to `plant`."""
    parser = Parser(plant)
    add_to_package_map(parser)
    (instance,) = parser.AddModelsFromUrl(f"package://{PACKAGE}/{name}.urdf")
    return instance


def add_arm(plant: MultibodyPlant, *, floor_height: float) -> ModelInstanceIndex:
    """The arm, its base frame being the world's, on a pedestal above a floor at `floor_height` m."""
    arm = add_model(plant, "arm7")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link0", arm))
    for name, z in (("pedestal", 0.0), ("floor", floor_height)):
        instance = add_model(plant, name)
        frame = plant.GetFrameByName(name, instance)
        plant.WeldFrames(plant.world_frame(), frame, RigidTransform(as_array([0.0, 0.0, z])))
    return arm


def make_control_plant(time_step: float, *, payload: SpatialInertia, X_FlangeTool: RigidTransform) -> MultibodyPlant:
    """A finalized plant of the arm alone, with everything that it carries as one rigid body, and a frame `TOOL`.

    `payload` is the inertia of all bodies fixed to the flange, about and in the flange frame.
    """
    plant = MultibodyPlant(time_step)
    arm = add_model(plant, "arm7")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link0", arm))
    body = plant.AddRigidBody("payload", arm, payload)
    plant.WeldFrames(plant.GetFrameByName("flange", arm), body.body_frame())
    plant.AddFrame(FixedOffsetFrame(TOOL, plant.GetFrameByName("flange", arm), X_FlangeTool))
    plant.Finalize()
    return plant


def pose_at(plant: MultibodyPlant, frame: str, q: Sequence[float]) -> RigidTransform:
    """X_WF of `frame` at the generalized positions `q` of the finalized `plant`."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, as_array(q))
    return plant.GetFrameByName(frame).CalcPoseInWorld(context)


def spatial_inertia_of(plant: MultibodyPlant, instance: ModelInstanceIndex, q: Array, frame: str) -> SpatialInertia:
    """Inertia of `instance` at generalized positions `q` of the finalized `plant`, about and in `frame`."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.CalcSpatialInertia(context, plant.GetFrameByName(frame), plant.GetBodyIndices(instance))
