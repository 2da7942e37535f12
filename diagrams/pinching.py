"""Pinching: a gripper squeezes a ball of unknown stiffness and damping (paper, "Material Property ...")."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatVisualizer, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort

from drake_cafim.contact.normal import NORMAL_LAWS, NormalLaw
from drake_cafim.diagrams.arm import add_model
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.concealing import Concealed, conceal, connect_concealed, total_force
from drake_cafim.diagrams.configured import load_section
from drake_cafim.diagrams.control import JointGains, add_velocity_control
from drake_cafim.diagrams.movers import JawMover
from drake_cafim.diagrams.objects import Surface, add_fixture, add_shape, contact_with
from drake_cafim.diagrams.planner_contact import PlannerContact, TouchedPoint
from drake_cafim.diagrams.sensing import ContactForce, ToolState
from drake_cafim.diagrams.showing import View
from drake_cafim.diagrams.touching import applied_wrench, drake_wrench, export_touch
from drake_cafim.diagrams.tracked_contact import TrackedRobot
from drake_cafim.diagrams.tracking import TrackingConfig
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import (
    WorldKind,
    check_kind,
    check_truth,
    export_force,
    export_joints,
    export_tool_state,
)
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.parameters import Parameters
from drake_cafim.report.replay_data import Camera
from drake_cafim.tasks.laws import QuasiStatic, stiffness_and_damping
from drake_cafim.tasks.pinching import WORKING_FORCE, Pinching, hunt_crossley_pinching
from drake_cafim.tasks.pinching import pinching as pinching_task
from drake_cafim.tasks.task import Candidate, Task
from drake_cafim.typing import Array

OUTWARDS = as_array([[1.0, 0.0, 0.0]])  # of the left jaw
FINGER = 0.065  # m, from the gripper's base to the ball's centre, along z
FACE = as_array([0.0, 0.0, FINGER])  # m, of a jaw, where it touches, in the jaw's frame


@dataclass
class PinchingConfig:
    """Constants of the scenario. The planner's coordinate is a jaw's distance from the middle."""

    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001, contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
        )
    )
    # in world `drake` the truth sets the ball's modulus and dissipation at a working force of 4 N, see `ball_surface`
    working_force: float = WORKING_FORCE  # N
    # of the ball's mesh: at 3 mm the polyhedron's mean surface is 0.04 mm below the sphere, at 6 mm 0.16 mm
    resolution: float = 0.003  # m
    start: float = 0.024  # m
    gains: JointGains = field(default_factory=lambda: JointGains(stiffness=10000.0, damping=200.0))
    tracking: TrackingConfig = field(default_factory=lambda: TrackingConfig(period=0.002, ramp=0.02, acceleration=30.0))
    workspace: Workspace = field(
        default_factory=lambda: Workspace(lower=[0.002], upper=[0.037], braking_at_lower=30.0, braking_at_upper=30.0)
    )


def load_config(path: Path | None = None) -> PinchingConfig:
    """The configuration in the section `diagram:` of `pinching.yaml`, or of the scenario file at `path`."""
    return load_section(Path(__file__).with_name("pinching.yaml") if path is None else path, PinchingConfig())


def ball_surface(
    config: PinchingConfig, stiffness: float, damping: float = 0.0, dissipation: float | None = None
) -> Surface:
    """A surface whose contact force in Drake is about K d + C ḋ near the working force F = K d₀.

    Point contact: K exactly, and K d₀ · dissipation = C unless `dissipation` s/m is given. Hydroelastic:
    π E d₀² = F, dissipation as well.
    """
    depth = config.working_force / stiffness
    return Surface(
        modulus=config.working_force / (np.pi * depth**2),
        point_stiffness=stiffness,
        dissipation=damping / config.working_force if dissipation is None else dissipation,
        friction=0.5,
        resolution=config.resolution,
    )


def other_laws(config: PinchingConfig, task: Task) -> tuple[Candidate, ...]:
    """The contact laws that the ball may have beside the task's own.

    Their priors are those of the task at rest under the working force; of `hydroelastic` the true values are Drake's.
    """
    model = task.model
    assert isinstance(model, Pinching)
    rest = QuasiStatic(config.working_force, model.ball_radius)
    stiffness, damping = stiffness_and_damping(model.parameters, rest)
    truth = dict(task.truth)
    true_damping = truth.get("damping", config.working_force * truth.get("dissipation", 0.0))
    surface = ball_surface(config, truth["stiffness"], true_damping)
    found = []
    for law in NORMAL_LAWS:
        if law == model.law:
            continue
        values = rest.values(law, truth["stiffness"], true_damping)
        if law == "hydroelastic":
            values = {"modulus": surface.modulus, "dissipation": surface.dissipation}
        others = [parameter for parameter in model.parameters if parameter.nuisance]
        parameters = Parameters.of([*rest.priors(law, stiffness, damping), *others])
        resolution = config.resolution if law == "hydroelastic" else 0.0
        changed = replace(model, law=cast(NormalLaw, law), parameters=parameters, resolution=resolution)
        found.append(Candidate(law, changed, values))
    return tuple(found)


def build_world(
    config: PinchingConfig,
    truth: Mapping[str, float] | None = None,
    world: WorldKind = "drake",
    seed: int = 0,
    meshcat: Meshcat | None = None,
    concealed: Sequence[Concealed] = (),
) -> Diagram:
    """The Diagram of gripper and ball, its start state the default Context's (see `world.start_context`).

    .. pydrake_system::

        name: pinching
        input_ports: [command]
        output_ports: [measured_state, true_force, measured_force, plant_state, contact_results, joint_state,
            joint_effort, contact_wrench, tracked_pose, contacts]

    `command` (1,) m/s opens both jaws; `measured_state` (2,) is the left jaw's distance from the middle m and its
    velocity m/s; forces (1,) N push the left jaw outwards. `truth` may give `stiffness` N/m, and `damping` N s/m or
    `dissipation` s/m; with the latter the planner's law is Hunt and Crossley's.
    `contact_wrench` (6,) on the left jaw and its `tracked_pose` (7,) are those of `export_touch`.
    The effects `concealed` are in the plant, but no controller accounts for them.
    `contacts` (2,), only in world `drake`, counts hydroelastic and point contacts.
    """
    check_kind(world)
    model = hunt_crossley_pinching() if "dissipation" in (truth or {}) else Pinching()
    theta = check_truth("pinching", pinching_task(model).truth, truth or {})
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlant(config.plant_config, builder)
    gripper = add_model(plant, "gripper")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("gripper_base", gripper))
    _add_ball(plant, model.ball_radius, ball_surface(config, **theta) if world == "drake" else None)
    affected = conceal(plant, gripper, concealed)
    plant.Finalize()
    mover = JawMover(config.start)
    plant.SetDefaultPositions(gripper, mover.q_start)
    add_velocity_control(
        builder,
        plant,
        gripper,
        control_plant=_control_plant(config),
        mover=mover,
        command_period=model.period,
        workspace=config.workspace,
        tracking=config.tracking,
        gains=config.gains,
    )
    jaw = plant.GetBodyByName("left_jaw")
    state = export_tool_state(builder, plant, jaw, p_BT=FACE, axes=OUTWARDS)
    if world == "drake":
        force = _add_contact_sensor(builder, plant, jaw)
        wrench = drake_wrench(builder, plant, [jaw.name()])
    else:
        law = _add_planner_contact(builder, plant, model, model.parameters.vector(theta), state)
        force = law.GetOutputPort("contact_force")
        wrench = applied_wrench(builder, plant, law.GetOutputPort("spatial_forces"), jaw)
    added = connect_concealed(builder, plant, affected)
    link = affected.nominal.body("left_jaw").joint
    force = total_force(builder, link, added, OUTWARDS, force)
    export_force(builder, force, std=model.noise_std.tolist(), period=model.period, seed=seed)
    export_joints(builder, plant, gripper, affected)
    on_jaw = [port for joint, port in added if joint == link]
    export_touch(builder, plant, wrench, jaw, on_jaw)
    builder.ExportOutput(plant.get_state_output_port(), "plant_state")
    builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    diagram: Diagram = builder.Build()
    diagram.set_name("pinching")
    return diagram


def _control_plant(config: PinchingConfig) -> MultibodyPlant:
    plant = MultibodyPlant(config.plant_config.time_step)
    gripper = add_model(plant, "gripper")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("gripper_base", gripper))
    plant.Finalize()
    return plant


def _add_ball(plant: MultibodyPlant, radius: float, surface: Surface | None) -> None:
    """The ball on a thin post between the jaws, fixed in the world, so that both jaws have the same contact force."""
    ball = add_fixture(plant, "ball", RigidTransform(as_array([0.0, 0.0, FINGER])))
    add_shape(plant, ball, Sphere(radius), RigidTransform(), surface, color=(0.30, 0.62, 0.86, 0.85))
    post = RigidTransform(as_array([0.0, 0.0, 0.06]))
    plant.RegisterVisualGeometry(ball, post, Cylinder(0.003, 0.12), "post", as_array([0.5, 0.5, 0.5, 1.0]))


def _add_contact_sensor(builder: DiagramBuilder, plant: MultibodyPlant, jaw: RigidBody) -> OutputPort:
    sensor = ContactForce(plant=plant, body=jaw.index(), directions=OUTWARDS)
    builder.AddNamedSystem("force_sensor", sensor)
    builder.Connect(plant.get_contact_results_output_port(), sensor.get_input_port())
    builder.ExportOutput(sensor.GetOutputPort("contacts"), "contacts")
    return sensor.GetOutputPort("force")


def _add_planner_contact(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: Pinching,
    theta: Array,
    state: ToolState,
) -> LeafSystem:
    """The planner's law on the left jaw, and its mirror image on the right one."""
    law: LeafSystem = PlannerContact(model, theta, coordinates=1, points=_touched_points(plant))
    builder.AddNamedSystem("planner_contact", law)
    builder.Connect(state.get_output_port(), law.get_input_port())
    builder.Connect(law.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
    return law


def _touched_points(plant: MultibodyPlant) -> list[TouchedPoint]:
    jaws = (plant.GetBodyByName("left_jaw"), plant.GetBodyByName("right_jaw"))
    return [TouchedPoint(jaw.index(), FACE, as_array(side * OUTWARDS)) for jaw, side in zip(jaws, (1, -1), strict=True)]


def true_contact(config: PinchingConfig, truth: Mapping[str, float], contact: SphereContact) -> SphereContact:
    """The contact of a jaw and the ball by the law and with the numbers of world `drake`."""
    model = hunt_crossley_pinching() if "dissipation" in truth else Pinching()
    surface = ball_surface(config, **check_truth("pinching", pinching_task(model).truth, truth))
    return contact_with(surface, contact, config.plant_config.contact_model, surface.friction)


def tracked_robot(config: PinchingConfig) -> TrackedRobot:
    """The gripper with its control, for sensitivities through it."""

    def add(plant: MultibodyPlant) -> tuple[ModelInstanceIndex, RigidBody, Sequence[TouchedPoint]]:
        gripper = add_model(plant, "gripper")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("gripper_base", gripper))
        return gripper, plant.GetBodyByName("left_jaw"), _touched_points(plant)

    return TrackedRobot(
        time_step=config.plant_config.time_step,
        add=add,
        control_plant=_control_plant(config),
        mover=JawMover(config.start),
        p_BT=FACE,
        axes=OUTWARDS,
        origin=as_array(np.zeros(3)),
        workspace=config.workspace,
        tracking=config.tracking,
        gains=config.gains,
    )


def view(config: PinchingConfig) -> View:
    """The view of the replay: close to the jaws, with plans drawn upwards over time from the left jaw."""
    return View(
        axes=OUTWARDS,
        origin=as_array([0.0, -0.02, FINGER]),
        force_directions=OUTWARDS,
        force_offset=as_array([0.014, 0.0, 0.0]),
        force_scale=0.008,
        spread=as_array([0.0, 0.0, 0.4]),
        camera=Camera(eye=(0.04, -0.40, 0.15), target=(-0.05, 0.0, 0.055)),
        panel=(-0.235, 0.0, 0.065),
        panel_width=0.13,
        stroke=0.3,
    )
