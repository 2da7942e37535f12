"""The hefting Diagram: its ports, the arm's tracking, and the ball's contact forces in both worlds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import ContactResults
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from drake_cafim.diagrams import hefting
from drake_cafim.diagrams.sensing import contact_force_on
from drake_cafim.diagrams.world import start_context
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

GRAVITY = 9.81
# heft: accelerations between -8 and +14 m/s², speeds up to the bound of 1 m/s
COMMANDS = (0.0, 0.3, 0.7, 1.0, 0.7, 0.3, -0.1, -0.5, -0.9, -1.0, -0.3, 0.4, 0.2, -0.2, -0.5, -0.6, 0.0, 0.0, 0.0)
RECORDED = ("joint_state", "joint_effort", "contact_wrench", "tracked_pose")


@dataclass(frozen=True)
class Run:
    commands: Array  # (N,)
    state: Array  # (N, 2)
    true_force: Array  # (N,)
    measured_force: Array  # (N,)
    hydroelastic: Array  # (N,) contacts
    final: Array  # plant state


def simulate(diagram: Diagram, commands: Sequence[float], *, step: float, experiment: int = 0) -> Run:
    simulator = Simulator(diagram, start_context(diagram, experiment))
    context = simulator.get_mutable_context()
    port = diagram.GetInputPort("command")
    rows = []
    for index, command in enumerate(commands):
        port.FixValue(context, [command])
        simulator.AdvanceTo((index + 1) * step)
        contacts: ContactResults = diagram.GetOutputPort("contact_results").Eval(context)
        read = [diagram.GetOutputPort(f"{kind}_force").Eval(context)[0] for kind in ("true", "measured")]
        state = diagram.GetOutputPort("measured_state").Eval(context)
        rows.append([*state, *read, contacts.num_hydroelastic_contacts()])
    table = np.array(rows)
    final = np.array(diagram.GetOutputPort("plant_state").Eval(context))
    return Run(np.array(commands), table[:, :2], table[:, 2], table[:, 3], table[:, 4], final)


@pytest.fixture(scope="module", params=["drake", "model"])
def world(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def config() -> hefting.HeftingConfig:
    return hefting.load_config()


@pytest.fixture(scope="module")
def diagram(world: str, config: hefting.HeftingConfig) -> Diagram:
    return hefting.build_world(config, {"mass": 0.05}, world, seed=3)


@pytest.fixture(scope="module")
def run(diagram: Diagram, config: hefting.HeftingConfig) -> Run:
    return simulate(diagram, COMMANDS, step=config.time_step)


def test_ports(diagram: Diagram) -> None:
    inputs = [diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())]
    outputs = [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]
    assert inputs == ["command"]
    named = {"measured_state", "true_force", "measured_force", "plant_state", "contact_results", *RECORDED}
    assert set(outputs) - {"contacts"} == named
    assert diagram.GetInputPort("command").size() == 1
    assert diagram.GetOutputPort("measured_state").size() == 2


def test_hand_feels_what_the_ball_does(diagram: Diagram) -> None:
    simulator = Simulator(diagram, start_context(diagram))
    context = simulator.get_mutable_context()
    diagram.GetInputPort("command").FixValue(context, [0.3])
    simulator.AdvanceTo(0.2)
    wrench, pose, force = (
        np.array(diagram.GetOutputPort(name).Eval(context)) for name in ("contact_wrench", "tracked_pose", "true_force")
    )
    np.testing.assert_allclose(wrench[5], -force[0], atol=1e-9)
    # it presses below the ball's centre, at most a finger's width beside it
    about_ball = wrench[:3] - np.cross(pose[:3], wrench[3:])
    assert np.linalg.norm(about_ball[:2]) < 0.01 * force[0]


def test_start(diagram: Diagram, config: hefting.HeftingConfig) -> None:
    context = start_context(diagram)
    diagram.GetInputPort("command").FixValue(context, [0.0])
    state = diagram.GetOutputPort("measured_state").Eval(context)
    np.testing.assert_allclose(state, [config.start[0], 0.0], atol=1e-3)


def test_arm_tracks_the_commanded_velocity(run: Run, config: hefting.HeftingConfig) -> None:
    np.testing.assert_allclose(run.state[:, 1], run.commands, atol=0.02)
    ramps = 0.5 * config.time_step * (run.commands + np.concatenate([[0.0], run.commands[:-1]]))
    height = config.start[0] + np.cumsum(ramps)
    np.testing.assert_allclose(run.state[:, 0], height, atol=0.005)


def test_force_is_the_weight_and_the_inertia_of_the_ball(run: Run, config: hefting.HeftingConfig) -> None:
    acceleration = np.diff(run.commands, prepend=0.0) / config.time_step
    expected = 0.05 * (GRAVITY + acceleration)
    # the ball settles within a step at about 100 rad/s and half the critical damping, so the match is rough
    assert np.sqrt(np.mean((run.true_force - expected) ** 2)) < 0.08
    assert run.true_force[-1] == pytest.approx(0.05 * GRAVITY, abs=0.02)


def test_ball_stays_in_the_hand(run: Run, diagram: Diagram) -> None:
    plant = diagram.GetSubsystemByName("plant")
    context = plant.CreateDefaultContext()
    palm, ball = plant.GetFrameByName("palm"), plant.GetFrameByName("ball")
    start = plant.CalcRelativeTransform(context, palm, ball).translation()
    plant.SetPositionsAndVelocities(context, run.final)
    moved = plant.CalcRelativeTransform(context, palm, ball).translation() - start
    assert np.linalg.norm(moved) < 0.004


def test_hydroelastic_contact_occurs_throughout_the_motion_in_drakes_world(run: Run, world: str) -> None:
    if world == "drake":
        assert np.all(run.hydroelastic >= 1)
    else:
        assert np.all(run.hydroelastic == 0)


def test_noise_is_seeded_by_experiment(diagram: Diagram, config: hefting.HeftingConfig, run: Run) -> None:
    noise = run.measured_force - run.true_force
    again = simulate(diagram, COMMANDS[:3], step=config.time_step)
    other = simulate(diagram, COMMANDS[:3], step=config.time_step, experiment=1)
    np.testing.assert_array_equal(again.measured_force, run.measured_force[:3])
    assert np.all(other.measured_force != again.measured_force)
    np.testing.assert_array_equal(other.true_force, again.true_force)
    assert 0.5 * config.force_std < np.std(noise) < 1.6 * config.force_std


def test_heavier_ball_weighs_more(world: str, config: hefting.HeftingConfig) -> None:
    heavy = hefting.build_world(config, {"mass": 0.08}, world)
    run = simulate(heavy, [0.0, 0.0, 0.0, 0.0], step=config.time_step)
    assert run.true_force[-1] == pytest.approx(0.08 * GRAVITY, rel=0.03)


@pytest.mark.parametrize(
    ("truth", "kind", "message"),
    [
        ({"friction": 0.4}, "drake", "hefting: the truth names friction, expected mass"),
        ({"mass": -1.0}, "drake", "the true mass is -1.0"),
        ({}, "mujoco", "expected one of drake, model"),
    ],
)
def test_errors(truth: dict[str, float], kind: str, message: str, config: hefting.HeftingConfig) -> None:
    with pytest.raises(InputError, match=message):
        hefting.build_world(config, truth, kind)  # type: ignore[arg-type]


def test_packaged_file_equals_the_defaults(tmp_path: Path) -> None:
    empty = tmp_path / "mine.yaml"
    empty.write_text("model: arm.urdf\n")
    # Drake's own config structs compare by identity
    assert repr(hefting.load_config()) == repr(hefting.load_config(empty))


def test_ball_starts_at_rest_on_the_palm(diagram: Diagram, config: hefting.HeftingConfig) -> None:
    run = simulate(diagram, [0.0], step=0.002)
    # Drake's ball is a polyhedron within the sphere, which at first sinks in less
    assert run.true_force[0] == pytest.approx(0.05 * GRAVITY, rel=0.25)


def test_contact_force_on_the_hand_is_the_reaction(config: hefting.HeftingConfig) -> None:
    diagram = hefting.build_world(config, {}, "drake")
    plant = diagram.GetSubsystemByName("plant")
    context = start_context(diagram)
    simulator = Simulator(diagram, context)
    diagram.GetInputPort("command").FixValue(context, [0.0])
    simulator.AdvanceTo(0.05)
    results = diagram.GetOutputPort("contact_results").Eval(context)
    hand = plant.GetBodyIndices(plant.GetModelInstanceByName("hand"))
    on_ball = contact_force_on(results, plant, plant.GetBodyByName("ball").index())
    on_hand = sum(contact_force_on(results, plant, body) for body in hand)
    assert on_ball[2] == pytest.approx(0.05 * GRAVITY, rel=0.05)
    np.testing.assert_allclose(on_hand, -on_ball, atol=1e-9)
