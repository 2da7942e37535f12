"""A finalized Drake plant from a scenario's model file."""

from pathlib import Path

import numpy as np
import yaml
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import LoadModelDirectivesFromString, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import Scenario
from drake_cafim.typing import Array

MODEL_SUFFIXES = (".urdf", ".sdf", ".xml", ".dmd.yaml", ".dmd.yml", ".mjcf")


def add_plant(
    scenario: Scenario, folder: Path, builder: DiagramBuilder, time_step: float
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add the scenario's plant and scene graph to `builder`, finalized.

    `folder` is where a relative model path starts. Raises `InputError` for what Drake's parser refuses.
    """
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step)
    add_model(scenario, folder, plant)
    plant.Finalize()
    return plant, scene_graph


def add_model(scenario: Scenario, folder: Path, plant: MultibodyPlant) -> None:
    """Add the scenario's model, its welds and its gravity to `plant`, which is not finalized.

    `folder` is where a relative model path starts. Raises `InputError` for what Drake's parser refuses.
    """
    parser = Parser(plant)
    parser.package_map().Add("drake_cafim_models", Path(__file__).parents[1] / "models")
    _parse(parser, scenario, folder)
    for weld in scenario.weld:
        if not plant.HasBodyNamed(weld.body):
            names = ", ".join(_body_names(plant))
            raise InputError(
                f"{scenario.model}: weld names the body {weld.body!r}, which the model lacks; it has: {names}"
            )
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(weld.body))
    gravity: Array = np.array(scenario.gravity, dtype=float)
    plant.mutable_gravity_field().set_gravity_vector(gravity)


def _body_names(plant: MultibodyPlant) -> list[str]:
    """All bodies but the world."""
    instances = [ModelInstanceIndex(i) for i in range(2, plant.num_model_instances())]
    return [plant.get_body(i).name() for instance in instances for i in plant.GetBodyIndices(instance)]


def _parse(parser: Parser, scenario: Scenario, folder: Path) -> None:
    if scenario.directives:
        text = yaml.safe_dump({"directives": scenario.directives})
        try:
            ProcessModelDirectives(LoadModelDirectivesFromString(text), parser)
        except (RuntimeError, ValueError) as error:
            raise InputError(f"directives: {' '.join(str(error).split())}") from None
        return
    address = scenario.model
    if not address.startswith("package://") and not (folder / address).is_file():
        raise InputError(
            f"{folder / address}: there is no such model file, expected one of {', '.join(MODEL_SUFFIXES)}"
        )
    try:
        if address.startswith("package://"):
            parser.AddModelsFromUrl(address)
        else:
            parser.AddModels(folder / address)
    except (RuntimeError, ValueError, SystemExit) as error:
        raise InputError(f"{address}: Drake's parser refuses it: {' '.join(str(error).split())}") from None
