"""The force guard: its belief about forces, and commands that keep forces within the limit."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from scipy.stats import multivariate_normal

from drake_cafim.belief import Belief
from drake_cafim.commands.run import RunRequest, check_request
from drake_cafim.design.force_belief import (
    FilterConfig,
    ForceBelief,
    _resample,
    first_force_belief,
    learn,
    magnitude,
    predicted_forces,
)
from drake_cafim.design.force_guard import GuardConfig, guarded_command
from drake_cafim.design.guard_system import ForceGuard
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.errors import InputError
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.experiment.kinematic_world import kinematic_world
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing

CONFIG = GuardConfig()
LIMIT = 10.0


def certain(theta, mean=(1.0, 0.0), variance=1e-12):
    return ForceBelief(np.array([theta]), np.zeros(1), np.array([mean]), variance * np.eye(2)[np.newaxis])


def test_gains_are_the_kalman_filters_and_weights_the_evidence():
    """Without drift: each hypothesis is a regression of the measured on λ̂ and λ̂²/L, the first gains its prior."""
    config, random = FilterConfig(drift=0.0, points=3, fewest=0.0), np.random.default_rng(0)
    model = pinching().model
    depths = random.uniform(0.012, 0.019, 30)
    theta = np.array([[600.0, 0.0], [700.0, 0.0], [2000.0, 0.0]])
    at_limit, growth = np.square(config.gain_std)
    prior = np.array([[at_limit + growth, -growth], [-growth, growth]])
    np.testing.assert_allclose(
        first_force_belief(model, Belief.prior(model.parameters), config).covariance, np.tile(prior, (3, 1, 1))
    )
    first = np.array([1.0, 0.0])
    belief = ForceBelief(theta, np.zeros(3), np.tile(first, (3, 1)), np.tile(prior, (3, 1, 1)))
    force = 1.2 * 600.0 * (0.020 - depths) + model.force_std * random.normal(size=30)
    for depth, reading in zip(depths, force, strict=True):
        belief = learn(model, belief, np.array([depth, 0.0]), np.array([reading]), LIMIT, config)
    y, evidence = force / model.force_std, []
    for k, (stiffness, _) in enumerate(theta):
        predicted = stiffness * (0.020 - depths)
        x = np.stack([predicted, predicted**2 / LIMIT], axis=1) / model.force_std
        covariance = np.linalg.inv(np.linalg.inv(prior) + x.T @ x)
        np.testing.assert_allclose(belief.covariance[k], covariance, rtol=1e-9)
        np.testing.assert_allclose(belief.mean[k], covariance @ (np.linalg.solve(prior, first) + x.T @ y), rtol=1e-8)
        evidence.append(multivariate_normal.logpdf(y, x @ first, np.eye(30) + x @ prior @ x.T))
    np.testing.assert_allclose(np.diff(belief.log_weight), np.diff(evidence), rtol=1e-8)


def test_a_force_that_grows_with_the_square_of_the_depth_is_learned():
    """As Drake's hydroelastic contact: alike at 4 N, and more than three times as steep at the limit."""
    model, config, random = pinching().model, FilterConfig(), np.random.default_rng(1)
    belief = first_force_belief(model, Belief.prior(model.parameters), config)
    for depth in np.tile(np.linspace(0.001, 0.006, 20), 20):
        true = 4.0 * (depth / 0.005) ** 2 + model.force_std * random.normal(size=1)
        belief = learn(model, belief, np.array([0.020 - depth, 0.0]), true, LIMIT, config)
    for depth in (0.003, 0.005, 0.006):
        mean, _ = magnitude(belief, predicted_forces(model, np.array([0.020 - depth, 0.0]), belief.theta), LIMIT)
        assert belief.weight @ mean == pytest.approx(4.0 * (depth / 0.005) ** 2, abs=0.5)


def test_without_contact_nothing_is_learned():
    model = pinching().model
    belief = certain([800.0, 10.0], mean=(1.3, 0.2), variance=0.01)
    config = FilterConfig(points=1)
    for _ in range(200):
        belief = learn(model, belief, np.array([0.03, 0.0]), np.array([5.0]), LIMIT, config)
    np.testing.assert_array_equal(belief.mean, [[1.3, 0.2]])
    walked = 0.01 + config.drift**2 * 200 * model.period
    np.testing.assert_allclose(belief.covariance[0], walked * np.eye(2))


def test_a_face_that_is_not_felt_is_believed_no_more():
    """The tip stands where a long box would push it away with 5 N, and feels noise alone."""
    model, config, random = contouring().model, FilterConfig(), np.random.default_rng(0)
    force = first_force_belief(model, Belief.prior(model.parameters), config)
    assert force.theta.shape == (config.points, 2)
    # a point below the bound is moved to it
    np.testing.assert_allclose(force.weight @ force.theta, model.parameters.mean, rtol=1e-2)
    robot = np.array([0.5 + 0.5 * 0.20, 0.0, 0.0, 0.0])
    for _ in range(60):
        force = learn(model, force, robot, 3.0 * random.standard_normal(2), LIMIT, config)
    # what is still believed of the force there, but for 5 %, is less than at first
    mean, _ = magnitude(force, predicted_forces(model, robot, force.theta), LIMIT)
    assert force.weight[np.abs(mean) > 5.0].sum() < 0.05


def test_placing_anew_keeps_the_mean_and_widens_by_the_spacing():
    random = np.random.default_rng(1)
    model = pinching().model
    old = ForceBelief(
        np.array([800.0, 10.0]) + random.normal(size=(40, 2)),
        random.normal(size=40),
        np.array([1.0, 0.0]) + 0.1 * random.normal(size=(40, 2)),
        np.tile(0.02 * np.eye(2), (40, 1, 1)),
    )
    new = _resample(model, old)
    np.testing.assert_allclose(new.theta.mean(axis=0), old.weight @ old.theta)
    np.testing.assert_allclose(new.mean.mean(axis=0), old.weight @ old.mean)
    np.testing.assert_allclose(new.covariance, old.covariance)
    assert (new.log_weight == 0.0).all()
    away = old.theta - old.weight @ old.theta
    expected = old.weight @ away**2 + 40 ** (-2 / 2) * old.theta.var(axis=0)
    np.testing.assert_allclose(new.theta.var(axis=0), expected, rtol=1e-6)
    again = ForceBelief.from_vector(new.vector(), 40)
    for name, value in vars(new).items():
        np.testing.assert_array_equal(getattr(again, name), value)


def test_what_it_lets_through_is_all_of_a_mild_command_and_never_too_much():
    model = pinching().model
    theta = np.array([800.0, 10.0])
    free, pressed = np.array([0.030, 0.0]), np.array([0.0105, 0.0])

    def allowed(robot, command, belief=None):
        belief = certain(theta) if belief is None else belief
        return guarded_command(model, belief, robot, np.array([command]), LIMIT, CONFIG)[0]

    assert allowed(free, -0.3) == pytest.approx(-0.3)
    assert allowed(pressed, 0.1) == pytest.approx(0.1)
    deeper = allowed(pressed, -0.3)  # 7.6 N already
    assert deeper > -0.3
    reached = pressed + np.array([model.period * deeper, deeper])
    assert predicted_forces(model, reached, theta[np.newaxis])[0, 0] <= LIMIT
    assert allowed(pressed, -0.3, certain(theta, (1.3, 0.1), 0.04)) > max(deeper, 0.0)  # it goes back
    near = np.array([0.021, 0.0])
    assert allowed(near, -0.3, certain(theta, (1.0, 0.4), 0.16)) > allowed(near, -0.3)


def test_it_slides_along_what_it_must_not_press():
    """The tip, 4 N deep in the box's near side, may go along the side as commanded, and not deeper as fast."""
    model = contouring().model
    robot = np.array([0.5, -0.025 - 0.010 + 0.008, 0.0, 0.0])
    allowed = guarded_command(model, certain([0.126, 0.05]), robot, np.array([0.3, 0.5]), LIMIT, CONFIG)
    assert allowed[0] == pytest.approx(0.3) and allowed[1] < 0.25


@pytest.mark.parametrize("scale", [0.5, 0.7])
def test_pinching_with_a_prior_too_low_keeps_the_limit(scale):
    task = pinching().with_prior_mean(scale)
    forces = {}
    for guard in (False, True):
        result = run(task, Options(seed=3, experiments=2, force_guard=guard))
        forces[guard] = [experiment.behaviour["max_force"] for experiment in result.experiments]
        assert all(experiment.behaviour["contact_fraction"] > 0.2 for experiment in result.experiments)
    assert max(forces[True]) <= task.model.force_limit < max(forces[False])


@pytest.mark.long
def test_contouring_with_a_box_harder_than_believed_keeps_the_limit():
    true = contouring().with_prior_mean(1.3)
    task = replace(true, model=replace(true.model, stiffness=0.5 * true.model.stiffness))
    world = [kinematic_world(true, seed=1) for _ in range(2)]
    bold, guarded = (
        run(task, Options(seed=1, force_guard=guard), made).experiments[0]
        for guard, made in zip((False, True), world, strict=True)
    )
    assert guarded.behaviour["max_force"] <= 10.0 < bold.behaviour["max_force"]
    assert guarded.behaviour["contact_fraction"] > 0.1


def test_the_system_holds_what_it_learned_and_forgets_it():
    task = pinching()
    model, robot, command = task.model, np.array([0.0185, 0.0]), np.array([-0.2])
    guard = ForceGuard(model, 10.0)
    simulator = Simulator(guard)
    context = simulator.get_mutable_context()
    belief = Belief.prior(model.parameters)
    for name, value in {"command": command, "measured_state": robot, "measured_force": [8.0]}.items():
        guard.GetInputPort(name).FixValue(context, np.array(value))
    guard.begin(context, belief)
    simulator.AdvanceTo(9.5 * model.period)
    force = first_force_belief(model, belief, CONFIG.filter)
    expected = [guarded_command(model, force, robot, command, 10.0, CONFIG)]
    for _ in range(10):
        force = learn(model, force, robot, np.array([8.0]), LIMIT, CONFIG.filter)
    expected.append(guarded_command(model, force, robot, command, 10.0, CONFIG))
    output = guard.GetOutputPort("command")
    np.testing.assert_allclose(output.Eval(context), expected[1])
    guard.begin(context, belief)
    np.testing.assert_allclose(output.Eval(context), expected[0])
    assert expected[0] != expected[1]


def test_a_task_without_a_limit_is_refused():
    with pytest.raises(InputError, match="--force-guard: rubbing has no force_limit"):
        run(rubbing(), Options(force_guard=True))
    with pytest.raises(InputError, match="no force_limit"):
        check_request(RunRequest("hefting", options=Options(force_guard=True)))
    check_request(RunRequest("pinching", options=Options(force_guard=True)))


def test_contact_aware_is_guarded_where_a_robot_executes():
    task = pinching()
    assert run(task, Options(experiments=1)).options.force_guard is False
    stage = stage_of(load(resolve("pinching")), "pinching")
    short = replace(stage.task, periods=3)
    for options, guarded in (
        (Options(experiments=1), True),
        (Options(experiments=1, force_guard=False), False),
        (Options("random", experiments=1), False),
    ):
        assert run(short, options, stage.world("model", 0)).options.force_guard is guarded
