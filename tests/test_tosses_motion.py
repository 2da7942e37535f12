"""A free body's equations of motion, its simulation, and the derivatives of both."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from scipy.integrate import solve_ivp

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw
from drake_cafim.diagnosis.tosses.flight import Flights, fly
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.innovation import Innovation
from drake_cafim.diagnosis.tosses.tangent import Tangent, displace
from drake_cafim.dynamics.free_body_state import Moment, State
from drake_cafim.dynamics.rotations import exponential, inverse, logarithm, product, rotation_matrices
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance
from drake_cafim.effects.contact_friction import (
    ContactAnisotropicFriction,
    ContactPresliding,
    ContactRollingResistance,
    ContactStribeckFriction,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.normal_contact import (
    ContactAdhesion,
    ContactHuntCrossleyDissipation,
    ContactNonlinearStiffness,
    ContactViscoelasticRelaxation,
)
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from tests.tosses import BALL, BLOCK, SCENARIO, thrown_scene

TIGHT = np.array([1e-5] * 3 + [1e-4] * 3)


def _states(seed: int, count: int) -> State:
    rng = np.random.default_rng(seed)
    p = rng.normal(0.0, 0.1, (count, 3)) + np.array([0.0, 0.0, 1.0])
    return State.of(
        p, exponential(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)), rng.normal(0, 5, (count, 3))
    )


def _turned(p: list[float], v: list[float]) -> State:
    """One body, turned and turning."""
    turn, w = np.array([[0.3, 0.2, 0.1]]), np.array([[1.0, -2.0, 0.5]])
    return State.of(np.array([p]), exponential(turn), np.array([v]), w)


def _flown(body: FreeBody, start: State, times: np.ndarray) -> Flights:
    count = len(start)
    return fly(body, start, times, np.full(count, times.shape[1]), np.zeros(count, dtype=int), ("a",), TIGHT)


@pytest.fixture
def block(tmp_path: Path) -> Scene:
    return thrown_scene(tmp_path, BLOCK, com="0.01 -0.02 0.015")


def test_free_motion_is_drakes(block: Scene) -> None:
    body, states, plant = FreeBody(block.physics), _states(1, 4), block.plant
    none = Moment(np.zeros(4), np.zeros(4, dtype=int), ("a",))
    found = body.acceleration(states, np.zeros((4, 8), dtype=bool), np.zeros((4, 8, 0)), none)
    context = block.diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    link = plant.GetBodyByName("body")
    for k in range(4):
        R = RotationMatrix(rotation_matrices(states.quaternion[k : k + 1])[0])
        plant.SetFreeBodyPose(own, link, RigidTransform(R, states.p[k]))
        plant.SetFreeBodySpatialVelocity(own, link, SpatialVelocity(states.w[k], states.v[k]))
        A = plant.EvalBodySpatialAccelerationInWorld(own, link)
        np.testing.assert_allclose(found[k], [*A.translational(), *A.rotational()], atol=1e-9)


def test_a_bounce_is_that_of_a_fine_solver(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    law = scene.physics.contacts[0].parameters
    start = State.of(np.array([[0.0, 0.0, 0.05]]), exponential(np.zeros((1, 3))), np.array([[0.8, 0.0, -1.0]]),
                  np.array([[0.0, -3.0, 0.0]]))  # fmt: skip
    times = np.arange(0.0, 0.12, 0.004)[None]
    flights = _flown(FreeBody(scene.physics), start, times)

    def slope(t: float, x: np.ndarray) -> list[float]:
        height, along, sinking, spin = x[1], x[2], -x[3], x[4]
        depth = 0.04 - height
        push = max(0.0, law.stiffness * depth + law.damping * sinking) if depth > 0.0 else 0.0
        slip = along - 0.04 * spin
        rub = -law.friction * push * np.tanh(slip / law.slip_velocity)
        return [along, x[3], rub / 0.3, push / 0.3 - 9.81, -0.04 * rub / 1.9e-4]

    truth = solve_ivp(slope, (0.0, times[0, -1]), [0.0, 0.05, 0.8, -1.0, -3.0], t_eval=times[0], rtol=1e-9, atol=1e-11,
                      max_step=1e-4)  # fmt: skip
    np.testing.assert_allclose(flights.at_samples.p[:, 0], truth.y[0], atol=2e-6)
    np.testing.assert_allclose(flights.at_samples.p[:, 2], truth.y[1], atol=2e-6)
    np.testing.assert_allclose(flights.at_samples.w[:, 1], truth.y[4], atol=2e-3)
    assert flights.at_samples.v[-1, 2] > 0.05  # it has bounced


@pytest.mark.parametrize("shape", [BALL, BLOCK])
@pytest.mark.parametrize(
    ("law", "numbers"),
    [
        ("paper", {"damping": 6.0, "slip_velocity": 0.01}),
        ("kelvin_voigt", {"damping": 6.0, "resistance": 40.0}),
        ("kelvin_voigt", {"damping": 6.0}),
        ("hunt_crossley", {"dissipation": 0.5, "slip_velocity": 0.01}),
    ],
)
def test_compiled_flights_are_those_that_take_any_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: str, law: NormalLaw, numbers: dict[str, float]
) -> None:
    physics = thrown_scene(tmp_path, shape).physics
    parameters = ContactParameters(stiffness=4000.0, friction=0.35, **numbers)
    contact = replace(physics.contacts[0], law=ContactLaw(law), parameters=parameters)
    body = FreeBody(replace(physics, contacts=(contact,)))
    start, times = _turned([0.0, 0.0, 0.09], [0.5, 0.3, -1.0]), np.arange(0.0, 0.2, 0.004)[None]
    compiled = _flown(body, start, times)
    monkeypatch.setattr(FreeBody, "plain", False)
    any_force = _flown(body, start, times)
    assert np.any(compiled.fine.mode)
    np.testing.assert_array_equal(compiled.fine.mode, any_force.fine.mode)
    np.testing.assert_allclose(compiled.at_samples.numbers, any_force.at_samples.numbers, rtol=1e-9, atol=1e-9)
    for part in ("flight", "time", "step"):
        np.testing.assert_allclose(getattr(compiled.fine, part), getattr(any_force.fine, part), rtol=1e-6, atol=1e-9)


def test_a_flight_beyond_all_numbers_ends_and_leaves_the_others_alone(tmp_path: Path) -> None:
    body, sane = FreeBody(thrown_scene(tmp_path, BLOCK).physics), _turned([0.0, 0.0, 0.07], [0.3, 0.1, -0.5])
    absurd = _turned([0.0, 0.0, -1e306], [0.3, 0.1, -0.5])
    times = np.arange(0.0, 0.1, 0.004)[None]
    both = _flown(body, State(np.concatenate([absurd.numbers, sane.numbers])), np.repeat(times, 2, axis=0))
    states = both.at_samples.numbers.reshape(2, times.size, -1)
    assert np.all(np.isnan(states[0, 1:]))
    np.testing.assert_array_equal(states[1], _flown(body, sane, times).at_samples.numbers)


@pytest.mark.parametrize("shape", [BALL, BLOCK])
@pytest.mark.parametrize(
    "effects",
    [
        [ContactPresliding("body/ground", {"distance": 3e-4})],
        [ContactViscoelasticRelaxation("body/ground", {"stiffness": 2000.0, "time_constant": 0.02}),
         ContactPresliding("body/ground", {"distance": 3e-4})],
        [ContactNonlinearStiffness("body/ground", {"cubic": 1e8}),
         ContactHuntCrossleyDissipation("body/ground", {"dissipation": 0.8}),
         ContactStribeckFriction("body/ground", {"static": 0.6, "velocity": 0.1})],
        [ContactRollingResistance("body/ground", {"coefficient": 2e-3}),
         ContactAnisotropicFriction("body/ground", {"friction_1": 0.5, "friction_2": 0.2, "angle": 0.4})],
        [AerodynamicDrag("body", {"coefficient": 0.1})],
        [ExternalDisturbance("body", {"x": 2.0, "y": -1.0, "z": 3.0, "start": 0.02, "stop": 0.1}, "a"),
         ExternalDisturbance("body", {"x": 0.5, "y": 1.0, "z": 0.0, "start": 0.05, "stop": 0.07}),
         ExternalDisturbance("body", {"x": 50.0, "y": 0.0, "z": 0.0, "start": 0.0, "stop": 0.2}, "another"),
         ContactPresliding("body/ground", {"distance": 3e-4})],
    ],
)  # fmt: skip
def test_compiled_flights_know_what_changes_a_contact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: str, effects: list[Effect]
) -> None:
    body = FreeBody(thrown_scene(tmp_path, shape, com="0.003 -0.002 0.001").physics.with_effects(effects))
    assert body.plain
    start, times = _turned([0.0, 0.0, 0.07], [0.3, 0.1, -0.5]), np.arange(0.0, 0.2, 0.004)[None]
    compiled = _flown(body, start, times)
    monkeypatch.setattr(FreeBody, "plain", False)
    any_force = _flown(body, start, times)
    assert np.any(compiled.fine.mode)
    np.testing.assert_array_equal(compiled.fine.mode, any_force.fine.mode)
    np.testing.assert_allclose(compiled.at_samples.numbers, any_force.at_samples.numbers, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(compiled.fine.memory, any_force.fine.memory, rtol=1e-6, atol=1e-10)


def test_a_push_moves_the_flights_of_its_own_recording_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    push = ExternalDisturbance("body", {"x": 2.0, "y": 0.0, "z": 1.0, "start": 0.02, "stop": 0.1}, "b")
    bare = thrown_scene(tmp_path, BLOCK).physics
    state, times = _turned([0.0, 0.0, 0.07], [0.3, 0.1, -0.5]), np.tile(np.arange(0.0, 0.2, 0.004), (2, 1))
    start, counts = State(np.tile(state.numbers, (2, 1))), np.full(2, times.shape[1])

    def flown(body: FreeBody) -> np.ndarray:
        flights = fly(body, start, times, counts, np.array([0, 1]), ("a", "b"), TIGHT)
        return flights.at_samples.numbers.reshape(2, times.shape[1], 13)

    free, pushed = flown(FreeBody(bare)), flown(FreeBody(bare.with_effects([push])))
    np.testing.assert_array_equal(pushed[0], free[0])
    assert np.max(np.abs(pushed[1] - free[1])) > 0.01
    monkeypatch.setattr(FreeBody, "plain", False)
    np.testing.assert_allclose(flown(FreeBody(bare.with_effects([push]))), pushed, rtol=1e-8, atol=1e-8)


def test_what_compiled_flights_do_not_know_is_left_to_the_others(tmp_path: Path) -> None:
    bare = thrown_scene(tmp_path).physics
    twice = [AerodynamicDrag("body", {"coefficient": c}) for c in (0.1, 0.2)]
    adhesion = ContactAdhesion("body/ground", {"force": 1.0, "range": 1e-3})
    assert FreeBody(bare).plain
    assert not any(FreeBody(bare.with_effects(effects)).plain for effects in ([adhesion], twice))


def _differences(a: Flights, b: Flights) -> np.ndarray:
    turned = logarithm(product(a.at_samples.quaternion, inverse(b.at_samples.quaternion)))
    return np.concatenate([a.at_samples.p - b.at_samples.p, turned], axis=1).reshape(*a.shape, 6)


@pytest.mark.parametrize("shape", [BALL, BLOCK])
def test_slopes_are_those_of_finite_steps_through_a_bounce(tmp_path: Path, shape: str) -> None:
    scene = thrown_scene(tmp_path, shape)
    body = FreeBody(scene.physics)
    start = _turned([0.0, 0.0, 0.09], [0.5, 0.3, -1.0])
    times = np.arange(0.0, 0.1, 0.004)[None]
    flights = _flown(body, start, times)
    assert np.any(flights.fine.mode)
    moment = Moment(flights.fine.time, np.zeros(len(flights.fine.time), dtype=int), ("a",))
    tangent = Tangent(body, flights, times, moment)
    by_start = tangent.propagate(np.eye(12)[None], None)
    for k, size in ((2, 1e-4), (4, 1e-3), (6, 1e-2), (8, 1e-3)):
        step = np.zeros((1, 12))
        step[0, k] = size
        finite = _differences(_flown(body, displace(start, step), times), _flown(body, displace(start, -step), times))
        finite /= 2.0 * size
        assert np.max(np.abs(by_start[..., :6, k] - finite)) < 0.05 * np.max(np.abs(finite))
    stiffer = [FreeBody(scene.physics_at(scene.priors.mean + np.array([step, 0.0]))) for step in (30.0, -30.0)]
    finite = _differences(*(_flown(body, start, times) for body in stiffer)) / 60.0
    change = (tangent.acceleration(stiffer[0]) - tangent.acceleration(stiffer[1])) / 60.0
    by_stiffness = tangent.propagate(np.zeros((1, 12, 1)), change[..., None])[..., :6, 0]
    assert np.max(np.abs(by_stiffness - finite)) < 0.1 * np.max(np.abs(finite))


@pytest.mark.parametrize("shape", [BALL, BLOCK])
@pytest.mark.parametrize(
    "effect",
    [
        ContactPresliding("body/ground", {"distance": 3e-4}),
        ContactViscoelasticRelaxation("body/ground", {"stiffness": 2000.0, "time_constant": 0.02}),
    ],
)
def test_slopes_go_through_what_a_contact_remembers(tmp_path: Path, shape: str, effect: Effect) -> None:
    body = FreeBody(thrown_scene(tmp_path, shape).physics.with_effects([effect]))
    start = _turned([0.0, 0.0, 0.07], [0.3, 0.1, -0.5])
    times = np.arange(0.0, 0.08, 0.004)[None]
    flights = _flown(body, start, times)
    assert np.any(flights.fine.mode)
    moment = Moment(flights.fine.time, np.zeros(len(flights.fine.time), dtype=int), ("a",))
    by_start = Tangent(body, flights, times, moment).propagate(np.eye(12)[None], None)
    for k, size in ((2, 1e-5), (6, 1e-3), (7, 1e-3), (10, 1e-2)):
        step = np.zeros((1, 12))
        step[0, k] = size
        finite = _differences(_flown(body, displace(start, step), times), _flown(body, displace(start, -step), times))
        finite /= 2.0 * size
        assert np.max(np.abs(by_start[..., :6, k] - finite)) < 0.1 * np.max(np.abs(finite))


def test_a_winding_contact_is_simulated_as_well_as_it_is_measured(tmp_path: Path) -> None:
    """Within half of a sample's noise after 0.2 s, during which it winds up and throws back the ball's spin."""
    effect = ContactPresliding("body/ground", {"distance": 2e-3})
    body = FreeBody(thrown_scene(tmp_path, BALL).physics.with_effects([effect]))
    start = _turned([0.0, 0.0, 0.07], [0.3, 0.1, -0.5])
    times = np.arange(0.0, 0.2, 0.004)[None]
    std = np.repeat([1e-4, 2e-3], 3)
    count, recording = np.array([times.shape[1]]), np.zeros(1, dtype=int)
    usual, exact = (fly(body, start, times, count, recording, ("a",), noise) for noise in (std, 1e-4 * std))
    assert np.any(exact.fine.mode)
    off = np.abs(_differences(usual, exact)) / std
    assert np.max(off) < 0.5, np.max(off)


def test_innovations_do_not_see_the_initial_state_and_keep_the_noise_white() -> None:
    rng = np.random.default_rng(7)
    slopes = 3e3 * rng.normal(size=(2, 9, 6, 12))
    innovation = Innovation.of(slopes)
    seen, carried = innovation(slopes @ np.arange(12.0)[:, None])
    assert np.max(np.abs(seen[:, 2:])) < 0.02
    found = np.linalg.solve(innovation.triangle, carried)
    np.testing.assert_allclose(found[..., 0], np.tile(np.arange(12.0), (2, 1)), rtol=0.01, atol=0.01)
    unit = np.zeros((2, 9, 6, 54))
    unit.reshape(2, 54, 54)[:] = np.eye(54)
    rows = innovation(unit)[0][:, 2:].reshape(2, 42, 54)
    np.testing.assert_allclose(rows @ np.swapaxes(rows, 1, 2), np.broadcast_to(np.eye(42), (2, 42, 42)), atol=0.01)


def test_sizes_of_the_body_can_be_unknown(tmp_path: Path) -> None:
    unknown = "unknown:\n  - {parameter: height, body: body, mean: 0.07, std: 0.01}\n"
    scene = thrown_scene(tmp_path, BLOCK, scenario=SCENARIO.replace("unknown:\n", unknown))
    assert np.ptp(scene.physics.contacts[0].points[:, 2]) == pytest.approx(0.07)
    with pytest.raises(InputError, match="radius"):
        thrown_scene(tmp_path, BLOCK, scenario=SCENARIO.replace("unknown:\n", unknown.replace("height", "radius")))


def test_two_bodies_that_nothing_holds_are_refused(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    text = (tmp_path / "body.urdf").read_text()
    arm = '<link name="tip"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>'
    arm += '<joint name="hinge" type="revolute"><parent link="body"/><child link="tip"/><axis xyz="0 0 1"/>'
    arm += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    (tmp_path / "body.urdf").write_text(text.replace("</robot>", arm))
    with pytest.raises(InputError, match="nothing holds body"):
        Scene.build(replace(scene.scenario), tmp_path, "toss")
