"""Hefting: an arm with a hand carries a ball of unknown mass on its palm (paper, "Mass Estimation Experiments")."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from drake_cafim.contact import ContactParameters
from drake_cafim.contact.system import SphereContact
from drake_cafim.corrected.world import AffectedRobot
from drake_cafim.diagrams.arm import (
    TOOL,
    add_arm,
    add_model,
    make_control_plant,
    pose_at,
    spatial_inertia_of,
)
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.concealing import Concealed, conceal, connect_concealed
from drake_cafim.diagrams.configured import load_section
from drake_cafim.diagrams.control import JointGains, add_velocity_control
from drake_cafim.diagrams.movers import ArmMover
from drake_cafim.diagrams.objects import Surface, add_ball
from drake_cafim.diagrams.sensing import ContactForce
from drake_cafim.diagrams.showing import View
from drake_cafim.diagrams.touching import applied_wrench, drake_wrench, export_touch
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
from drake_cafim.report.replay_data import Camera
from drake_cafim.typing import Array

UP = as_array([[0.0, 0.0, 1.0]])
PALM_FACE = 0.0111  # m, height of the palm's face over its frame, along its x (models/hand.urdf)
BALL_RADIUS = 0.033  # m (models/tennis_ball.urdf)
WRIST = 0.095  # m, from the wrist to the palm's frame along its z (models/hand.urdf)
X_FLANGE_PALM = RigidTransform(as_array([0.0, 0.0, WRIST]))


@dataclass
class HandHold:
    """The posture in which the hand cups the ball, and the joint control that holds it."""

    # rad, SimLab's joints 0-15: index, middle, ring, thumb. Each finger stands 2 mm off the ball.
    posture: list[float] = field(
        default_factory=lambda: [
            *(-0.47, 1.61, 0.41, 0.557),
            *(0.0, 1.61, 0.652, 0.593),
            *(0.47, 1.61, 0.41, 0.557),
            *(0.736, 0.477, 1.408, 0.02),
        ]
    )
    # stiff, so that the hand is one body to the arm: at 5 N m/rad the fingers swing, and the arm's recordings show it
    stiffness: float = 200.0  # N m/rad
    damping: float = 2.0  # N m s/rad
    ball_z: float = -0.031  # m, where the ball lies, in the palm's frame


@dataclass
class HeftingConfig:
    """Constants of the scenario; lengths m, times s, masses kg, forces N. z is the height of the palm's face."""

    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001, contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
        )
    )
    workspace: Workspace = field(  # of z; rising, it brakes softer than g, or it would throw the ball
        default_factory=lambda: Workspace(lower=[0.0], upper=[0.6], braking_at_upper=7.5)
    )
    speed: float = 1.0  # m/s, bound of the commanded velocity
    start: list[float] = field(default_factory=lambda: [0.2])  # m
    time_step: float = 0.05  # s, between commands
    steps: int = 60  # commands in an experiment
    stiffness: float = 500.0  # N/m, of the planner's law
    damping: float = 5.0  # N s/m, of the planner's law
    force_std: float = 0.5  # N
    mass: float = 0.05  # kg, the truth unless given
    # Drake's contact with about the planner's stiffness and damping under the ball's weight at rest:
    # on a flat palm F = pi E d^2, hence dF/dd = 2 sqrt(pi E F) = 500 N/m, and damping F * dissipation = 5 N s/m
    ball: Surface = field(
        default_factory=lambda: Surface(modulus=4.0e4, dissipation=10.0, friction=0.6, resolution=0.01)
    )
    # rad; the palm faces up, its fingers 5 degrees down, so that the ball leans on them and never squeezes
    posture: list[float] = field(
        default_factory=lambda: [-0.89346, -1.19506, 1.9421, -2.12816, 0.03704, 1.41262, 2.09718]
    )
    floor_height: float = -0.4  # m
    hand: HandHold = field(default_factory=HandHold)
    gains: JointGains = field(default_factory=JointGains)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)


def load_config(path: Path | None = None) -> HeftingConfig:
    """The configuration in the section `diagram:` of `hefting.yaml`, or of the scenario file at `path`."""
    return load_section(Path(__file__).with_name("hefting.yaml") if path is None else path, HeftingConfig())


@dataclass(frozen=True)
class _Robot:
    """The world's plant, and the parts of it that the builder functions share."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    arm: ModelInstanceIndex
    hand: ModelInstanceIndex
    palm: RigidBody
    ball: RigidBody
    X_WPalm: RigidTransform  # at the start
    control_plant: MultibodyPlant
    concealed: AffectedRobot


def build_world(
    config: HeftingConfig,
    truth: Mapping[str, float] | None = None,
    world: WorldKind = "drake",
    seed: int = 0,
    meshcat: Meshcat | None = None,
    concealed: Sequence[Concealed] = (),
) -> Diagram:
    """The Diagram of arm, hand and ball, its start state the default Context's (see `world.start_context`).

    .. pydrake_system::

        name: hefting
        input_ports: [command]
        output_ports: [measured_state, true_force, measured_force, plant_state, contact_results, joint_state,
            joint_effort, contact_wrench, tracked_pose, contacts]

    `command` (1,) m/s is the palm's vertical velocity, reached over `tracking.ramp`; `measured_state` (2,) the
    height m and velocity m/s of the palm's face under the ball, read from the plant; the forces (1,) N are the
    vertical force of the hand on the ball. `truth` may give `mass` (kg). In world `model` the ball moves up and
    down over the palm, pushed by the planner's own law (stiffness, damping) alone.
    `contact_wrench` (6,) of the ball on the hand and the ball's `tracked_pose` (7,) are those of `export_touch`.
    The effects `concealed` are in the plant, but no controller accounts for them.
    `contacts` (2,), only in world `drake`, counts hydroelastic and point contacts.
    """
    check_kind(world)
    mass = check_truth("hefting", {"mass": config.mass}, truth or {})["mass"]
    builder = DiagramBuilder()
    robot = _add_bodies(builder, config, mass, world, concealed)
    _add_control(builder, config, robot)
    if world == "drake":
        force = _add_contact_sensor(builder, robot)
        hand = [robot.plant.get_body(index).name() for index in robot.plant.GetBodyIndices(robot.hand)]
        wrench = drake_wrench(builder, robot.plant, hand)
    else:
        force, pushing = _add_planner_contact(builder, config, robot)
        wrench = applied_wrench(builder, robot.plant, pushing, robot.palm)
    export_force(builder, force, std=[config.force_std], period=config.time_step, seed=seed)
    export_tool_state(builder, robot.plant, robot.palm, p_BT=_palm_point(config), axes=UP)
    connect_concealed(builder, robot.plant, robot.concealed)
    export_joints(builder, robot.plant, robot.arm, robot.concealed)
    export_touch(builder, robot.plant, wrench, robot.ball)
    builder.ExportOutput(robot.plant.get_state_output_port(), "plant_state")
    builder.ExportOutput(robot.plant.get_contact_results_output_port(), "contact_results")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, robot.scene_graph, meshcat)
    diagram: Diagram = builder.Build()
    diagram.set_name("hefting")
    return diagram


def view(config: HeftingConfig) -> View:
    """The view of the replay: from the front, with the hand at the right, plans and belief to its left."""
    tool = pose_at(_control_plant(config), TOOL, config.posture).translation()
    return View(
        axes=UP,
        origin=as_array([tool[0], tool[1], 0.0]),
        force_directions=UP,
        force_offset=as_array([0.0, 0.0, 2.0 * BALL_RADIUS]),
        force_scale=0.15,
        spread=as_array([0.0, -0.6, 0.0]),
        camera=Camera(eye=(1.55, -0.1, 0.62), target=(0.1, -0.05, 0.16)),
        panel=(-0.1, -0.95, 0.2),
    )


def _control_plant(config: HeftingConfig) -> MultibodyPlant:
    return make_control_plant(
        config.plant_config.time_step,
        payload=_hand_inertia(config),
        X_FlangeTool=X_FLANGE_PALM @ RigidTransform(_palm_point(config)),
    )


def _palm_point(config: HeftingConfig) -> Array:
    """The point T (3,) m of the palm's face under the ball, in the palm's frame."""
    return as_array([PALM_FACE, 0.0, config.hand.ball_z])


def _hand_inertia(config: HeftingConfig) -> SpatialInertia:
    """Inertia of the hand in its posture, about and in the flange frame."""
    plant = MultibodyPlant(config.plant_config.time_step)
    hand = add_model(plant, "hand")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", hand), X_FLANGE_PALM)
    plant.Finalize()
    return spatial_inertia_of(plant, hand, as_array(config.hand.posture), "world")


def _add_bodies(
    builder: DiagramBuilder, config: HeftingConfig, mass: float, world: WorldKind, concealed: Sequence[Concealed]
) -> _Robot:
    control_plant = _control_plant(config)
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlant(config.plant_config, builder)
    arm = add_arm(plant, floor_height=config.floor_height)
    hand = add_model(plant, "hand")
    palm = plant.GetBodyByName("palm", hand)
    plant.WeldFrames(plant.GetFrameByName("flange", arm), palm.body_frame(), X_FLANGE_PALM)
    _hold_hand(builder, plant, hand, config.hand)
    ball = add_ball(plant, mass=mass, radius=BALL_RADIUS, surface=config.ball if world == "drake" else None)
    X_WPalm = pose_at(control_plant, "flange", config.posture) @ X_FLANGE_PALM
    affected = conceal(plant, arm, concealed)
    robot = _Robot(plant, scene_graph, arm, hand, palm, ball, X_WPalm, control_plant, affected)
    _lay_ball(config, robot, mass, world)
    plant.Finalize()
    plant.SetDefaultPositions(arm, as_array(config.posture))
    plant.SetDefaultPositions(hand, as_array(config.hand.posture))
    builder.Connect(
        builder.GetSubsystemByName("hand_posture").get_output_port(), plant.get_desired_state_input_port(hand)
    )
    return robot


def _hold_hand(builder: DiagramBuilder, plant: MultibodyPlant, hand: ModelInstanceIndex, hold: HandHold) -> None:
    """Drake's implicit joint PD control on all sixteen joints, towards the posture at rest."""
    for index in plant.GetJointActuatorIndices():  # of one instance, Drake knows them only after Finalize
        actuator = plant.get_joint_actuator(index)
        if actuator.model_instance() == hand:
            actuator.set_controller_gains(PdControllerGains(p=hold.stiffness, d=hold.damping))
    desired = np.concatenate([hold.posture, np.zeros(len(hold.posture))])
    builder.AddNamedSystem("hand_posture", ConstantVectorSource(as_array(desired)))


def _lay_ball(config: HeftingConfig, robot: _Robot, mass: float, world: WorldKind) -> None:
    """Starts the ball at rest on the palm, pressed in by its weight; in world `model` guided along the vertical."""
    plant, weight = robot.plant, mass * 9.81
    p_WT = robot.X_WPalm @ _palm_point(config)
    if world == "drake":
        depth = np.sqrt(weight / (np.pi * config.ball.modulus))
        up_W = robot.X_WPalm.rotation().matrix()[:, 0]
        plant.SetDefaultFloatingBaseBodyPose(robot.ball, RigidTransform(p_WT + (BALL_RADIUS - depth) * up_W))
        return
    start = RigidTransform(p_WT + (BALL_RADIUS - weight / config.stiffness) * UP[0])
    guide = plant.AddFrame(FixedOffsetFrame("ball_guide", plant.world_frame(), start))
    plant.AddJoint(PrismaticJoint("ball_height", guide, robot.ball.body_frame(), UP[0]))


def _add_control(builder: DiagramBuilder, config: HeftingConfig, robot: _Robot) -> None:
    mover = ArmMover(
        plant=robot.control_plant,
        tool=robot.control_plant.GetFrameByName(TOOL),
        axes=UP,
        origin=as_array(np.zeros(3)),
        q_start=config.posture,
        period=config.tracking.period,
    )
    add_velocity_control(
        builder,
        robot.plant,
        robot.arm,
        control_plant=robot.control_plant,
        mover=mover,
        command_period=config.time_step,
        workspace=config.workspace,
        tracking=config.tracking,
        gains=config.gains,
    )


def _add_contact_sensor(builder: DiagramBuilder, robot: _Robot) -> OutputPort:
    sensor = builder.AddNamedSystem(
        "force_sensor", ContactForce(plant=robot.plant, body=robot.ball.index(), directions=UP)
    )
    builder.Connect(robot.plant.get_contact_results_output_port(), sensor.get_input_port())
    builder.ExportOutput(sensor.GetOutputPort("contacts"), "contacts")
    return sensor.GetOutputPort("force")


def _add_planner_contact(
    builder: DiagramBuilder, config: HeftingConfig, robot: _Robot
) -> tuple[OutputPort, OutputPort]:
    """The planner's law between the ball and the plane through T, whose normal is the vertical at the start.

    Returns its vertical force (1,) N on the ball, and its spatial forces.
    """
    plant = robot.plant
    law = builder.AddNamedSystem(
        "planner_contact",
        SphereContact(
            "kelvin_voigt",
            ContactParameters(stiffness=config.stiffness, damping=config.damping),
            sphere_body=robot.ball.index(),
            plane_body=robot.palm.index(),
            radius=BALL_RADIUS,
            X_AP=RigidTransform(robot.X_WPalm.rotation().inverse(), _palm_point(config)),
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), law.GetInputPort("body_poses"))
    builder.Connect(plant.get_body_spatial_velocities_output_port(), law.GetInputPort("body_spatial_velocities"))
    builder.Connect(law.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
    vertical = builder.AddNamedSystem("vertical_force", MatrixGain(UP))
    builder.Connect(law.GetOutputPort("contact_force"), vertical.get_input_port())
    return vertical.get_output_port(), law.GetOutputPort("spatial_forces")
