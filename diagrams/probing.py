"""The Diagram of an arm with a round-tipped rod that touches a fixed obstacle, for rubbing and contouring."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatVisualizer, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody, SpatialInertia, UnitInertia
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from drake_cafim.diagrams.arm import TOOL, add_arm, make_control_plant, pose_at
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.concealing import Concealed, conceal, connect_concealed, total_force
from drake_cafim.diagrams.control import JointGains, add_velocity_control
from drake_cafim.diagrams.movers import ArmMover
from drake_cafim.diagrams.objects import Surface, add_shape
from drake_cafim.diagrams.planner_contact import PlannerContact, TouchedPoint
from drake_cafim.diagrams.sensing import ContactForce
from drake_cafim.diagrams.touching import applied_wrench, drake_wrench, export_touch
from drake_cafim.diagrams.tracked_contact import TrackedRobot
from drake_cafim.diagrams.tracking import TrackingConfig
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import WorldKind, export_force, export_joints, export_tool_state
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array

ROD_MASS = 0.2  # kg
ROD_RADIUS = 0.008  # m


@dataclass
class ProbingArm:
    """Configuration of the arm, of the rod in its flange, and of their motion control."""

    posture: list[float] = field(default_factory=list)  # rad, at the start
    rod: float = 0.15  # m, from the flange to the centre of the tip
    tip_radius: float = 0.01  # m
    tip: Surface = field(default_factory=Surface)
    floor_height: float = -0.4  # m
    gains: JointGains = field(default_factory=JointGains)
    tracking: TrackingConfig = field(default_factory=lambda: TrackingConfig(ramp=0.02))
    workspace: Workspace = field(default_factory=Workspace)


@dataclass(frozen=True)
class Coordinates:
    """The planner's coordinates in W: p_W = origin + p·axes, axes (nu, 3); forces along `directions` (ny, 3)."""

    axes: Array
    origin: Array
    directions: Array


def build_probing_world(
    name: str,
    arm: ProbingArm,
    *,
    plant_config: MultibodyPlantConfig,
    coordinates: Coordinates,
    add_obstacle: Callable[[MultibodyPlant, bool], None],
    model: PlanningModel,
    theta: Array,
    world: WorldKind,
    seed: int,
    meshcat: Meshcat | None,
    concealed: Sequence[Concealed],
) -> Diagram:
    """The Diagram of arm, rod and obstacle; its start state is the default Context's (see `world.start_context`).

    .. pydrake_system::

        name: probing
        input_ports: [command]
        output_ports: [measured_state, true_force, measured_force, plant_state, contact_results, joint_state,
            joint_effort, contact_wrench, tracked_pose, contacts]

    `command` (nu,) m/s; `measured_state` (2 nu,), position and velocity of the tip's centre; forces (ny,) N on the
    tip; `contact_wrench` (6,) on the probe and its `tracked_pose` (7,) are those of `export_touch`. `add_obstacle` adds
    the obstacle, with contact if its second argument is true; in world `model` the contact law of the planner's `model`
    at the true `theta` acts on the tip instead. The effects `concealed` are in the plant, but no controller accounts
    for them.
    `contacts` (2,), only in world `drake`, counts hydroelastic and point contacts.
    """
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlant(plant_config, builder)
    instance = add_arm(plant, floor_height=arm.floor_height)
    probe = _add_probe(plant, arm, touches=world == "drake")
    add_obstacle(plant, world == "drake")
    affected = conceal(plant, instance, concealed)
    plant.Finalize()
    plant.SetDefaultPositions(instance, as_array(arm.posture))
    control_plant = make_probing_control_plant(arm, plant_config.time_step)
    mover = _mover(arm, control_plant, coordinates)
    add_velocity_control(
        builder,
        plant,
        instance,
        control_plant=control_plant,
        mover=mover,
        command_period=model.period,
        workspace=arm.workspace,
        tracking=arm.tracking,
        gains=arm.gains,
    )
    tip = as_array(np.zeros(3))  # the probe's frame
    state = export_tool_state(builder, plant, probe, p_BT=tip, axes=coordinates.axes, origin=coordinates.origin)
    if world == "drake":
        sensor = ContactForce(plant=plant, body=probe.index(), directions=coordinates.directions)
        builder.AddNamedSystem("force_sensor", sensor)
        builder.Connect(plant.get_contact_results_output_port(), sensor.get_input_port())
        builder.ExportOutput(sensor.GetOutputPort("contacts"), "contacts")
        force = sensor.GetOutputPort("force")
        wrench = drake_wrench(builder, plant, [probe.name()])
    else:
        touched = TouchedPoint(probe.index(), tip, coordinates.directions)
        law = PlannerContact(model, theta, coordinates=len(coordinates.axes), points=[touched])
        builder.AddNamedSystem("planner_contact", law)
        builder.Connect(state.get_output_port(), law.get_input_port())
        builder.Connect(law.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
        force = law.GetOutputPort("contact_force")
        wrench = applied_wrench(builder, plant, law.GetOutputPort("spatial_forces"), probe)
    added = connect_concealed(builder, plant, affected)
    link = affected.nominal.body("flange").joint
    force = total_force(builder, link, added, coordinates.directions, force)
    reading = MatrixGain(_measured_rows(model))
    builder.AddNamedSystem("sensor_axes", reading)
    builder.Connect(force, reading.get_input_port())
    export_force(builder, reading.get_output_port(), std=model.noise_std.tolist(), period=model.period, seed=seed)
    export_joints(builder, plant, instance, affected)
    export_touch(builder, plant, wrench, probe, [port for joint, port in added if joint == link])
    builder.ExportOutput(plant.get_state_output_port(), "plant_state")
    builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    diagram: Diagram = builder.Build()
    diagram.set_name(name)
    return diagram


def tracked_arm(arm: ProbingArm, coordinates: Coordinates, time_step: float) -> TrackedRobot:
    """The arm and rod with their control, for sensitivities through them."""
    control_plant = make_probing_control_plant(arm, time_step)

    def add(plant: MultibodyPlant) -> tuple[ModelInstanceIndex, RigidBody, Sequence[TouchedPoint]]:
        instance = add_arm(plant, floor_height=arm.floor_height)
        probe = _add_probe(plant, arm, touches=False)
        return instance, probe, [TouchedPoint(probe.index(), as_array(np.zeros(3)), coordinates.directions)]

    return TrackedRobot(
        time_step=time_step,
        add=add,
        control_plant=control_plant,
        mover=_mover(arm, control_plant, coordinates),
        p_BT=as_array(np.zeros(3)),
        axes=coordinates.axes,
        origin=coordinates.origin,
        workspace=arm.workspace,
        tracking=arm.tracking,
        gains=arm.gains,
    )


def _mover(arm: ProbingArm, control_plant: MultibodyPlant, coordinates: Coordinates) -> ArmMover:
    return ArmMover(
        plant=control_plant,
        tool=control_plant.GetFrameByName(TOOL),
        axes=coordinates.axes,
        origin=coordinates.origin,
        q_start=arm.posture,
        period=arm.tracking.period,
    )


def make_probing_control_plant(arm: ProbingArm, time_step: float) -> MultibodyPlant:
    """The plant of arm and rod by which the controller computes; its frame `TOOL` is at the tip's centre."""
    rod = SpatialInertia(ROD_MASS, as_array([0.0, 0.0, 0.5 * arm.rod]), _rod_inertia(arm))
    return make_control_plant(time_step, payload=rod, X_FlangeTool=_tip_in_flange(arm))


def tip_at_start(arm: ProbingArm) -> Array:
    """The tip's centre (3,) m in W at the start."""
    return as_array(pose_at(make_probing_control_plant(arm, 0.001), TOOL, arm.posture).translation())


def _tip_in_flange(arm: ProbingArm) -> RigidTransform:
    return RigidTransform(as_array([0.0, 0.0, arm.rod]))


def _rod_inertia(arm: ProbingArm) -> UnitInertia:
    """The unit inertia about the flange of a rod from there to the tip."""
    centre = as_array([0.0, 0.0, 0.5 * arm.rod])
    about_centre = UnitInertia.SolidCylinder(ROD_RADIUS, arm.rod, as_array([0.0, 0.0, 1.0]))
    return about_centre.ShiftFromCenterOfMass(centre)


def _add_probe(plant: MultibodyPlant, arm: ProbingArm, *, touches: bool) -> RigidBody:
    """A body `probe` whose frame is the tip's centre, z along the rod, welded to the flange."""
    instance = plant.AddModelInstance("probe")
    centre = as_array([0.0, 0.0, -0.5 * arm.rod])
    about_centre = UnitInertia.SolidCylinder(ROD_RADIUS, arm.rod, as_array([0.0, 0.0, 1.0]))
    inertia = SpatialInertia(ROD_MASS, centre, about_centre.ShiftFromCenterOfMass(centre))
    probe = plant.AddRigidBody("probe", instance, inertia)
    plant.WeldFrames(plant.GetFrameByName("flange"), probe.body_frame(), _tip_in_flange(arm))
    if not plant.geometry_source_is_registered():
        return probe
    surface = arm.tip if touches else None
    add_shape(plant, probe, Sphere(arm.tip_radius), RigidTransform(), surface, color=(0.95, 0.45, 0.10, 1.0))
    rod = RigidTransform(as_array([0.0, 0.0, -0.5 * arm.rod]))
    color = as_array([0.35, 0.38, 0.42, 1.0])
    plant.RegisterVisualGeometry(probe, rod, Cylinder(ROD_RADIUS, arm.rod), "rod", color)
    return probe


def _measured_rows(model: PlanningModel) -> Array:
    """The measurement matrix (ny, nλ): ∂(measured force)/∂λ of the planner's model."""
    state, motion = np.zeros(0), np.zeros(2 * len(model.velocity_bounds[0]))
    theta = model.parameters.mean
    force = model.contact(state, motion, theta)
    return as_array(model.measurement_jacobians(state, motion, force, theta).wrt_force)
