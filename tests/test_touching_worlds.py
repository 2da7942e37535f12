"""The Diagrams of rubbing, contouring and pinching: ports, tracking, and contact forces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.diagrams import contouring, pinching, rubbing
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.diagrams.configured import load_section
from drake_cafim.diagrams.movers import JawMover, rotation_error
from drake_cafim.diagrams.pinching import PinchingConfig
from drake_cafim.diagrams.planner_contact import PlannerContact, TouchedPoint
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import start_context
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import load as scenario_file
from drake_cafim.scene.address import resolve
from drake_cafim.scene.scene import Scene
from drake_cafim.tasks.contouring import contouring as contouring_task
from drake_cafim.tasks.pinching import hunt_crossley_pinching
from drake_cafim.tasks.pinching import pinching as pinching_task
from drake_cafim.tasks.rubbing import rubbing as rubbing_task
from drake_cafim.tasks.task import Task
from drake_cafim.typing import Array

# commands (m/s, steps): each motion finds what it touches, presses and slides or lets go
MOTIONS: dict[str, Sequence[tuple[Sequence[float], int]]] = {
    "rubbing": [((-0.5, 0.0), 46), ((-0.1, 0.0), 10), ((0.0, 0.4), 20), ((0.0, -0.4), 20), ((0.0, 0.0), 10)],
    "contouring": [((0.0, 0.3), 5), ((0.0, 0.0), 4), ((0.1, 0.0), 4), ((0.0, -0.3), 4), ((0.0, 0.0), 4)],
    "pinching": [((-0.2,), 2), ((-0.1,), 3), ((0.0,), 10), ((0.2,), 3), ((0.0,), 8)],
}
RECORDED = ("joint_state", "joint_effort", "contact_wrench", "tracked_pose")
pinching_point = resolve("pinching_point")


@dataclass(frozen=True)
class Scenario:
    name: str
    module: ModuleType
    task: Task


@dataclass(frozen=True)
class Run:
    commands: Array  # (T, nu)
    state: Array  # (T, 2 nu)
    force: Array  # (T, ny)
    hydroelastic: Array  # (T,)
    wrench: Array  # (T, 6) about Wo, moment first
    pose: Array  # (T, 7)


def load(name: str) -> Scenario:
    modules = {"rubbing": rubbing, "contouring": contouring, "pinching": pinching}
    tasks: dict[str, Callable[[], Task]] = {
        "rubbing": rubbing_task,
        "contouring": contouring_task,
        "pinching": pinching_task,
    }
    return Scenario(name, modules[name], tasks[name]())


def simulate(diagram: Diagram, scenario: Scenario) -> Run:
    simulator = Simulator(diagram, start_context(diagram))
    context = simulator.get_mutable_context()
    commands = [command for command, count in MOTIONS[scenario.name] for _ in range(count)]
    states, forces, contacts, wrenches, poses = [], [], [], [], []
    for index, command in enumerate(commands):
        diagram.GetInputPort("command").FixValue(context, command)
        simulator.AdvanceTo((index + 1) * scenario.task.model.period)
        states.append(np.array(diagram.GetOutputPort("measured_state").Eval(context)))
        forces.append(np.array(diagram.GetOutputPort("true_force").Eval(context)))
        contacts.append(diagram.GetOutputPort("contact_results").Eval(context).num_hydroelastic_contacts())
        wrenches.append(np.array(diagram.GetOutputPort("contact_wrench").Eval(context)))
        poses.append(np.array(diagram.GetOutputPort("tracked_pose").Eval(context)))
    found = (states, forces, contacts, wrenches, poses)
    return Run(np.array(commands), *(np.array(rows) for rows in found))


@pytest.fixture(scope="module", params=sorted(MOTIONS))
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return load(request.param)


@pytest.fixture(scope="module", params=["drake", "model"])
def world(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def diagram(scenario: Scenario, world: str) -> Diagram:
    built: Diagram = scenario.module.build_world(scenario.module.load_config(), {}, world, seed=1)
    return built


@pytest.fixture(scope="module")
def run(diagram: Diagram, scenario: Scenario) -> Run:
    return simulate(diagram, scenario)


def test_ports(diagram: Diagram, scenario: Scenario, world: str) -> None:
    axes = len(scenario.task.robot_start) // 2
    outputs = {diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())}
    named = {"measured_state", "true_force", "measured_force", "plant_state", "contact_results", *RECORDED}
    assert outputs == named | ({"contacts"} if world == "drake" else set())
    assert diagram.GetInputPort("command").size() == axes
    assert diagram.GetOutputPort("measured_state").size() == 2 * axes
    assert diagram.GetOutputPort("measured_force").size() == len(scenario.task.model.noise_std)


def test_start_is_the_tasks(diagram: Diagram, scenario: Scenario) -> None:
    state = diagram.GetOutputPort("measured_state").Eval(start_context(diagram))
    np.testing.assert_allclose(state, scenario.task.robot_start, atol=1e-3)


def test_contact_is_there_and_is_hydroelastic_in_drakes_world(run: Run, world: str) -> None:
    touched = np.linalg.norm(run.force, axis=1) > 0.1
    assert touched.sum() >= 3
    assert not touched[0]
    if world == "drake":
        assert np.all(run.hydroelastic[touched] >= 1)
    else:
        assert not run.hydroelastic.any()


def test_tool_follows_where_it_was_told_to_go_on(run: Run, scenario: Scenario) -> None:
    axes = run.commands.shape[1]
    wait = int(np.ceil(0.12 / scenario.task.model.period))
    same = np.all(run.commands[1:] == run.commands[:-1], axis=1)
    settled = np.array([index >= wait and bool(same[index - wait : index].all()) for index in range(len(run.commands))])
    assert settled.sum() >= 3
    error = run.state[:, axes:] - run.commands
    # contact pushes on a computed-torque controller that knows nothing of it
    assert np.abs(error[settled]).max() < 0.08


def test_force_of_the_model_world_is_the_planners(run: Run, scenario: Scenario, world: str) -> None:
    model, theta = scenario.task.model, scenario.task.theta
    predicted = np.array([model.contact(np.zeros(0), state, theta) for state in run.state])
    if world == "model":
        np.testing.assert_allclose(run.force, predicted, atol=0.2)
    else:
        peak = np.linalg.norm(predicted, axis=1).max()
        # another law, the same size: within a factor of three at the strongest contact
        assert 1 / 3 < np.linalg.norm(run.force, axis=1).max() / peak < 3


def test_compliant_point_contact_has_the_stated_stiffness() -> None:
    config = pinching.load_config()
    config.plant_config.contact_model = "point"
    scenario = load("pinching")
    run = simulate(pinching.build_world(config, {"stiffness": 800.0, "damping": 10.0}, "drake"), scenario)
    still = np.abs(run.state[:, 1]) < 2e-3
    depth = 0.020 - run.state[:, 0]
    pressed = still & (depth > 1e-3)
    assert pressed.sum() >= 2
    np.testing.assert_allclose(run.force[pressed, 0], 800.0 * depth[pressed], rtol=0.05)


@pytest.mark.parametrize(("approximation", "follows"), [("lagged", True), ("similar", True), ("sap", False)])
def test_which_approximations_follow_hunt_and_crossleys_law(approximation: str, follows: bool) -> None:
    config = load_section(pinching_point, PinchingConfig())
    config.plant_config.discrete_contact_approximation = approximation
    model = hunt_crossley_pinching()
    truth = {"stiffness": 800.0, "dissipation": 2.5}
    run = simulate(pinching.build_world(config, truth, "drake"), load("pinching"))
    predicted = np.array([model.contact(np.zeros(0), state, model.parameters.vector(truth)) for state in run.state])
    touched = run.force[:, 0] > 0.1
    assert touched.sum() >= 5 and np.abs(run.state[touched, 1]).max() > 0.05
    assert (np.abs(run.force - predicted).max() < 0.1) == follows


def test_point_contact_is_a_scenario_of_its_own() -> None:
    stage = stage_of(scenario_file(pinching_point), "pinching_point")
    assert stage.task.truth == {"stiffness": 800.0, "dissipation": 2.5}
    diagram = stage.diagram("drake", 0)
    run = simulate(diagram, load("pinching"))
    assert (run.force[:, 0] > 0.1).any() and not run.hydroelastic.any()
    scene = Scene.load("pinching_point")
    face = scene.physics.contacts[0]
    assert face.radius == 0.006 and face.law.normal == "paper"


@pytest.mark.parametrize(
    ("effect", "at", "parameters", "expected"),
    [
        ("surface_offset", "ball", {"offset": 1e-3}, lambda depth: 800.0 * 1e-3 + 0.0 * depth),
        ("contact_nonlinear_stiffness", "left_tip/ball", {"cubic": 4e6}, lambda depth: 4e6 * depth**3),
    ],
)
def test_a_concealed_change_of_a_contact_pushes_and_is_felt(
    effect: str, at: str, parameters: dict[str, float], expected: Callable[[Array], Array]
) -> None:
    stage = stage_of(scenario_file(pinching_point), "pinching_point")
    run = simulate(stage.diagram("drake", 0, concealed=[Concealed(effect, at, parameters)]), load("pinching"))
    bare = simulate(stage.diagram("drake", 0), load("pinching"))
    depth = 0.020 - run.state[:, 0]
    still = (np.abs(run.state[:, 1]) < 2e-3) & (depth > 1e-3)
    assert still.sum() >= 2
    np.testing.assert_allclose(run.force[still, 0] - 800.0 * depth[still], expected(depth[still]), rtol=0.05, atol=0.02)
    # it opens the jaws against their control, which knows nothing of it
    assert np.max(run.state[:, 0] - bare.state[:, 0]) > 1e-5


def test_wrench_is_that_of_the_contact_force(run: Run, scenario: Scenario, world: str) -> None:
    axes = scenario.module.view(scenario.module.load_config()).force_directions
    np.testing.assert_allclose(run.wrench[:, 3:] @ axes.T, run.force, atol=1e-9)
    about_body = run.wrench[:, :3] - np.cross(run.pose[:, :3], run.wrench[:, 3:])
    size = np.linalg.norm(run.force, axis=1)
    lever = np.linalg.norm(about_body, axis=1)[size > 0.5] / size[size > 0.5]
    if scenario.name == "pinching":  # of a jaw, from its base to where it touches
        np.testing.assert_allclose(lever, 0.065, atol=1e-3)
    else:  # of a round tip, its centre
        assert lever.max() < 0.041


@pytest.mark.parametrize("name", ["rubbing", "contouring"])
def test_recorded_wrench_is_that_of_drakes_law_on_the_scenarios_contact(name: str) -> None:
    """Place, law and lever: the soft tip is pressed flat, and rubs where it meets the wall, nearer than its radius."""
    stage, scene = stage_of(scenario_file(resolve(name)), name), Scene.load(name)
    diagram = stage.diagram("drake", 0)
    simulator = Simulator(diagram, start_context(diagram))
    context, felt, expected, slips = simulator.get_mutable_context(), [], [], []
    law = load(name).module.true_contact(stage.config, stage.task.truth, scene.physics.contacts[0])
    for index, command in enumerate(command for command, count in MOTIONS[name] for _ in range(count)):
        diagram.GetInputPort("command").FixValue(context, command)
        simulator.AdvanceTo((index + 1) * stage.task.model.period)
        state = np.array(diagram.GetOutputPort("joint_state").Eval(context))
        moving = motion(scene.tree, state[None, :7], state[None, 7:])
        p_WC = moving.point(6, law.p_JC)[0][0]
        by_law = replace(scene.physics, contacts=(law,)).contact_wrenches(moving)[0, law.joint]
        np.testing.assert_allclose(by_law, law.wrench(moving)[0], atol=1e-9)
        slips.append(np.linalg.norm(law.touch(moving).slip))
        acting = np.array(diagram.GetOutputPort("contact_wrench").Eval(context))
        for wrench, found in ((acting, felt), (by_law, expected)):
            found.append(np.concatenate([wrench[:3] - np.cross(p_WC, wrench[3:]), wrench[3:]]))
    error, sizes = np.array(felt) - expected, np.array(expected)
    # where it hardly slips, Drake's friction sticks
    touching = (np.linalg.norm(sizes[:, 3:], axis=1) > 0.5) & (np.array(slips) > 0.005)
    assert touching.sum() >= 4
    assert np.sqrt(np.mean(error[touching, 3:] ** 2)) < 0.03 * np.abs(sizes[:, 3:]).max()
    # about the tip's centre, to which pressure on a hard tip has no lever
    lever = 0.06 * np.abs(sizes[:, :3]).max() if name == "rubbing" else 0.0003 * np.abs(sizes[:, 3:]).max()
    assert np.sqrt(np.mean(error[touching, :3] ** 2)) < lever


def test_box_of_the_scenario_pushes_by_the_planners_law() -> None:
    """At sides and edges, and damped: tips at random places about a corner of the box, moving in the plane."""
    stage, scene = stage_of(scenario_file(resolve("contouring")), "contouring"), Scene.load("contouring")
    contact = contouring.true_contact(stage.config, stage.task.truth, scene.physics.contacts[0])
    task = stage.with_laws(stage.task, "all").with_law("hydroelastic")
    theta = task.model.parameters.vector({**stage.task.truth, "modulus": 5.0e4, "dissipation": 0.5})
    random = np.random.default_rng(2)
    corner = np.array([0.563, -0.025])
    for p, v in zip(corner + random.uniform(-0.015, 0.012, (60, 2)), random.uniform(-0.2, 0.2, (60, 2)), strict=True):
        touch = contact.touch(_translating(scene, contact, np.array([*p, 0.05]), np.array([*v, 0.0])))
        expected = task.model.contact(np.zeros(0), np.concatenate([p, v]), theta)
        np.testing.assert_allclose(contact.force(touch)[0][0], [*expected, 0.0], atol=1e-7)
    # a spring as stiff in its place pushes away from the nearest point
    touch = contact.touch(_translating(scene, contact, np.array([0.567, -0.028, 0.05]), np.zeros(3)))
    spring = replace(contact, law=ContactLaw("kelvin_voigt"), parameters=ContactParameters(stiffness=500.0))
    np.testing.assert_allclose(spring.force(touch)[0][0], 500.0 * 0.005 * np.array([0.8, -0.6, 0.0]), atol=1e-9)
    beside = _translating(scene, contact, np.array([0.563, 0.0, 0.05]), np.zeros(3))
    np.testing.assert_allclose(spring.raised(0.001).touch(beside).penetration, 0.011)


def _translating(scene: Scene, contact: SphereContact, p_WC: Array, v_WC: Array) -> Motion:
    """A motion whose last frame translates: the tip's centre at `p_WC` with `v_WC`; the other frames are at rest."""
    still = motion(scene.tree, np.zeros((1, 7)), np.zeros((1, 7)))
    R, p, V = still.R_WJ.copy(), still.p_WJ.copy(), still.velocities.copy()
    p[0, contact.joint] = p_WC - R[0, contact.joint] @ contact.p_JC
    V[0, contact.joint] = [0.0, 0.0, 0.0, *v_WC]
    return replace(still, R_WJ=R, p_WJ=p, velocities=V)


def test_friction_of_drakes_wall_is_the_truth() -> None:
    scenario = load("rubbing")
    run = simulate(rubbing.build_world(rubbing.load_config(), {"friction": 0.3}, "drake"), scenario)
    sliding = (np.abs(run.state[:, 3]) > 0.3) & (run.force[:, 0] > 0.5)
    assert sliding.sum() >= 5
    ratio = -run.force[sliding, 1] / run.force[sliding, 0] * np.sign(run.state[sliding, 3])
    np.testing.assert_allclose(ratio, 0.3, atol=0.02)


def test_wrong_truth_is_named() -> None:
    with pytest.raises(InputError, match="pinching: the truth names mass, expected stiffness, damping"):
        pinching.build_world(pinching.load_config(), {"mass": 1.0})
    with pytest.raises(InputError, match=r"contouring: the true width is 0\.0, expected a positive number"):
        contouring.build_world(contouring.load_config(), {"width": 0.0})


@pytest.mark.parametrize(
    ("command", "position", "velocity", "expected"),
    [(0.5, 0.3, 0.0, 0.5), (1.0, 0.6, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.2, 0.65, 0.0, -2.0), (0.0, 0.6, 1.0, -1.0)],
)
def test_workspace_cuts_commands(command: float, position: float, velocity: float, expected: float) -> None:
    box = Workspace(lower=[0.0], upper=[0.6])
    arguments: Any = [np.array([value]) for value in (command, position, velocity)]
    allowed = box.allowed(*arguments, period=0.05, ramp=0.05)
    np.testing.assert_allclose(allowed, [expected], atol=1e-12)


def test_jaws_mirror() -> None:
    mover = JawMover(0.024)
    np.testing.assert_array_equal(mover.joint_velocity(mover.q_start, np.array([0.1])), [0.1, 0.1])


def test_rotation_error_is_the_turn_in_the_world() -> None:
    start, turn = RotationMatrix.MakeYRotation(0.4), RotationMatrix.MakeZRotation(0.2)
    np.testing.assert_allclose(rotation_error(start, turn @ start), [0.0, 0.0, 0.2], atol=1e-12)


def test_joint_velocity_limits_slow_the_arm_down() -> None:
    diagram = rubbing.build_world(rubbing.load_config(), {}, "model")
    plant = diagram.GetSubsystemByName("plant")
    arm = plant.GetModelInstanceByName("arm7")
    limits = np.array([2.175] * 4 + [2.61] * 3)  # rad/s, the Panda's
    simulator = Simulator(diagram, start_context(diagram))
    context = simulator.get_mutable_context()
    diagram.GetInputPort("command").FixValue(context, [-1.0, 0.0])
    most = 0.0
    for step in range(1, 25):
        simulator.AdvanceTo(0.02 * step)
        velocities = plant.GetVelocities(plant.GetMyContextFromRoot(context), arm)
        most = max(most, float((np.abs(velocities) / limits).max()))
    assert 0.95 < most < 1.05


def test_planners_contact_pushes_the_tool() -> None:
    scenario = load("pinching")
    body, p_BT = BodyIndex(3), np.array([0.0, 0.0, 0.065])
    outwards = np.array([[1.0, 0.0, 0.0]])
    point = TouchedPoint(body, p_BT, outwards)
    system = PlannerContact(scenario.task.model, scenario.task.theta, coordinates=1, points=[point])
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, [0.015, 0.0])
    (applied,) = system.GetOutputPort("spatial_forces").Eval(context)
    np.testing.assert_allclose(applied.F_Bq_W.translational(), [800.0 * 0.005, 0.0, 0.0])
    np.testing.assert_allclose(applied.p_BoBq_B, p_BT)
    assert applied.body_index == body


@pytest.mark.parametrize("name", ["rubbing", "rubbing_two", "rubbing_tangential", "contouring"])
def test_the_scenarios_robot_is_the_worlds(name: str) -> None:
    """What is recorded is diagnosed against the scenario's model: the rod in the flange is there once in both."""
    stage, scene = stage_of(scenario_file(resolve(name)), name), Scene.load(name)
    world = stage.diagram("drake", 0).GetSubsystemByName("plant")
    plants = (world, scene.plant)
    for q in np.random.default_rng(1).uniform(-1.0, 1.0, (3, 7)):
        matrices = []
        for plant in plants:
            context = plant.CreateDefaultContext()
            plant.SetPositions(context, plant.GetModelInstanceByName("arm7"), q)
            matrices.append((plant.CalcMassMatrix(context), plant.CalcGravityGeneralizedForces(context)))
        np.testing.assert_allclose(matrices[0][0], matrices[1][0], atol=1e-6)
        np.testing.assert_allclose(matrices[0][1], matrices[1][1], atol=1e-6)


def test_why_no_contact_effect_acts_is_said() -> None:
    adhesion = Concealed("contact_adhesion", "palm/ball", {"force": 2.0, "range": 0.001})
    with pytest.raises(InputError, match=r"contact_adhesion@palm/ball: hefting names no contact .*its ball is free"):
        stage_of(scenario_file(resolve("hefting")), "hefting").diagram("drake", 0, concealed=[adhesion])
    tilt = Concealed("surface_tilt", "box", {"y_slope_x": 0.1, "y_slope_y": 0.0})
    with pytest.raises(InputError, match="surface_tilt@box: it is of a plane, and tip/box is a box touched all round"):
        stage_of(scenario_file(resolve("contouring")), "contouring").diagram("drake", 0, concealed=[tilt])
