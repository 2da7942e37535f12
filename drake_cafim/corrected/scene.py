"""Adds a scene to a Diagram: its plant, and a system for every effect."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Protocol, TypeAlias, get_args

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.corrected.brakes import connect_brakes
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.contacts import changed_contacts
from drake_cafim.corrected.corrected_plant import CorrectedPlant
from drake_cafim.corrected.plant import change_plant, couple_followers, hold_joints
from drake_cafim.corrected.wiring import Wiring
from drake_cafim.description.parser_log import capture_log
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.tree import Tree
from drake_cafim.errors import InputError
from drake_cafim.scenario.holding import locked_positions
from drake_cafim.scenario.model_file import add_model
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Scenario

Contact: TypeAlias = Literal["scenario", "drake"]


class Simulated(Protocol):
    """The attributes of `drake_cafim.Scene` that a simulation needs."""

    @property
    def name(self) -> str: ...
    @property
    def scenario(self) -> Scenario: ...
    @property
    def folder(self) -> Path: ...
    @property
    def tree(self) -> Tree: ...
    @property
    def physics(self) -> Physics: ...
    @property
    def nominal_contacts(self) -> Sequence[SphereContact]: ...
    @property
    def wrench_sensors(self) -> Sequence[WrenchSensor]: ...


def add_scene(
    scene: Simulated,
    builder: DiagramBuilder,
    plant_config: MultibodyPlantConfig | None = None,
    contact: Contact = "scenario",
    period: float = 1e-3,
) -> CorrectedPlant:
    """Adds the scene's plant and the systems of its effects to `builder`; arguments as for `Scene.add_to`.

    Raises `InputError` where `contact` is neither "scenario" nor "drake".
    """
    if contact not in get_args(Contact):
        raise InputError(f"{scene.name}: contact {contact!r}, expected one of {', '.join(get_args(Contact))}")
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlant(plant_config or MultibodyPlantConfig(), builder)
    # with sampled outputs the plant would step before the other systems' discrete updates, which would see it one
    # step ahead
    plant.SetUseSampledOutputPorts(False)
    add_model(scene.scenario, scene.folder, plant)
    hold_joints(plant, locked_positions(scene.scenario.lock))
    change_plant(plant, scene.tree, scene.physics)
    couple_followers(plant, scene.tree, scene.name)
    with capture_log():
        plant.Finalize()
    if contact == "scenario":
        _exclude_collisions(plant, scene_graph)
    wiring = Wiring.around(builder, plant, scene.physics.tree, Clock(plant.time_step() or period))
    connect_brakes(builder, plant)
    entries, asked, driving = wiring.add_efforts(scene.physics)
    wiring.add_joint_forces(scene.physics, driving)
    wiring.add_body_forces(scene.physics)
    if contact == "scenario":
        wrenches = wiring.add_contacts([(touching, None) for touching in scene.physics.contacts])
    else:
        wrenches = wiring.add_contacts(changed_contacts(scene.physics.contacts, scene.nominal_contacts))
        wrenches += wiring.add_drake_contacts({sensor.joint for sensor in scene.wrench_sensors})
    wiring.close()
    bodies = [name.removeprefix("pose.") for name in scene.scenario.channels if name.startswith("pose.")]
    measured, columns = wiring.add_channels(scene.physics, asked, scene.wrench_sensors, bodies, wrenches)
    servo = {name: port for name, port in entries.items() if name != "effort"}
    return CorrectedPlant(plant, scene_graph, scene.tree.joint_names, entries["effort"], measured, columns, servo)


def _exclude_collisions(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
    """Excludes all collisions in Drake, since the contacts follow the scenario's laws."""
    bodies = [plant.get_body(BodyIndex(k)) for k in range(plant.num_bodies())]
    shapes = [shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    scene_graph.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(shapes)))
