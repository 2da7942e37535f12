"""The force guard: it learns from measured forces, and what it lets through stays within the limit."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from drake_cafim.belief import Belief
from drake_cafim.commands.run import RunRequest, check_request
from drake_cafim.design.force_guard import (
    Gains,
    GuardConfig,
    contact_force,
    first_gains,
    guarded_command,
    hypotheses,
    learn_gains,
)
from drake_cafim.design.guard_system import ForceGuard
from drake_cafim.errors import InputError
from drake_cafim.experiment import Options, run
from drake_cafim.kinematic_world import kinematic_world
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing

CONFIG = GuardConfig()


def test_gains_are_the_kalman_filters():
    """Without drift: a regression of the measured on the predicted forces, with the first gain as its prior."""
    config, random = GuardConfig(drift=0.0), np.random.default_rng(0)
    sigma = np.array([2.0, 0.5])
    predicted = random.normal(size=(40, 3, 2))
    measured = 1.7 * predicted[:, 0] + sigma * random.normal(size=(40, 2))
    gains = first_gains(3, config)
    for one, force in zip(predicted, measured, strict=True):
        gains = learn_gains(gains, one, force, sigma, 0.02, config)
    for k in range(3):
        x, y = (predicted[:, k] / sigma).ravel(), (measured / sigma).ravel()
        precision = 1.0 / config.gain_std**2 + x @ x
        assert gains.variance[k] == pytest.approx(1.0 / precision)
        assert gains.mean[k] == pytest.approx((1.0 / config.gain_std**2 + x @ y) / precision)
    assert abs(gains.mean[0] - 1.7) < 4.0 * np.sqrt(gains.variance[0])


def test_without_contact_nothing_is_learned_and_the_past_fades():
    gains = Gains(np.array([2.0]), np.array([0.01]))
    for _ in range(200):
        gains = learn_gains(gains, np.zeros((1, 2)), np.array([50.0, 50.0]), np.ones(2), 0.02, CONFIG)
    assert gains.mean[0] == 2.0 and gains.variance[0] == pytest.approx(CONFIG.gain_std**2)


def test_hypotheses_lie_on_the_principal_axes_within_bounds():
    model = pinching().model
    belief = Belief(model.parameters.names, np.array([600.0, 9.0]), np.array([[900.0, 30.0], [30.0, 4.0]]))
    points = hypotheses(model, belief, 2.0)
    assert points.shape == (5, 2)
    away = points - belief.mean
    distance = np.einsum("ki,ij,kj->k", away, np.linalg.inv(belief.covariance), away)
    np.testing.assert_allclose(distance, [0.0, 4.0, 4.0, 4.0, 4.0], atol=1e-9)
    assert (hypotheses(model, belief, 1e3)[:, 1] >= 0.0).all()


def test_what_it_lets_through_is_all_of_a_mild_command_and_never_too_much():
    model, sure = pinching().model, Gains(np.ones(1), np.full(1, 1e-12))
    theta = np.array([800.0, 10.0])
    free, pressed = np.array([0.030, 0.0]), np.array([0.0105, 0.0])

    def allowed(robot, command, gains=sure):
        return guarded_command(model, theta[np.newaxis], gains, robot, np.array([command]), 10.0, CONFIG)[0]

    assert allowed(free, -0.3) == pytest.approx(-0.3)
    assert allowed(pressed, 0.1) == pytest.approx(0.1)
    deeper = allowed(pressed, -0.3)  # 7.6 N already
    assert deeper > -0.3
    reached = pressed + np.array([model.period * deeper, deeper])
    assert contact_force(model, reached, theta)[0] <= 10.0
    assert allowed(pressed, -0.3, Gains(np.array([1.3]), np.array([0.04]))) > max(deeper, 0.0)  # it goes back
    near = np.array([0.021, 0.0])
    assert allowed(near, -0.3, first_gains(1, CONFIG)) > allowed(near, -0.3)


@pytest.mark.parametrize("scale", [0.5, 0.7])
def test_pinching_with_a_prior_too_low_keeps_the_limit(scale):
    task = pinching().with_prior_mean(scale)
    forces = {}
    for guard in (False, True):
        result = run(task, Options(seed=3, experiments=2, force_guard=guard))
        forces[guard] = [one.behaviour["max_force"] for one in result.experiments]
        assert all(one.behaviour["contact_fraction"] > 0.2 for one in result.experiments)
    assert max(forces[True]) <= task.model.force_limit < max(forces[False])


def test_contouring_with_a_box_harder_than_believed_keeps_the_limit():
    true = contouring().with_prior_mean(1.3)
    task = replace(true, model=replace(true.model, stiffness=0.5 * true.model.stiffness))
    world = [kinematic_world(true, seed=1) for _ in range(2)]
    bold, guarded = (
        run(task, Options(seed=1, force_guard=guard), one).experiments[0]
        for guard, one in zip((False, True), world, strict=True)
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
    values = {"command": command, "measured_state": robot, "measured_force": [8.0], "belief": belief.vector()}
    for name, value in values.items():
        guard.GetInputPort(name).FixValue(context, np.array(value))
    guard.begin_experiment(context)
    simulator.AdvanceTo(9.5 * model.period)
    points = hypotheses(model, belief, CONFIG.spread)
    predicted, gains = np.stack([contact_force(model, robot, point) for point in points]), first_gains(5, CONFIG)
    expected = [guarded_command(model, points, gains, robot, command, 10.0, CONFIG)]
    for _ in range(10):
        gains = learn_gains(gains, predicted, np.array([8.0]), model.noise_std, model.period, CONFIG)
    expected.append(guarded_command(model, points, gains, robot, command, 10.0, CONFIG))
    output = guard.GetOutputPort("command")
    np.testing.assert_allclose(output.Eval(context), expected[1])
    guard.begin_experiment(context)
    np.testing.assert_allclose(output.Eval(context), expected[0])
    assert expected[0] != expected[1]


def test_a_task_without_a_limit_is_refused():
    with pytest.raises(InputError, match="--force-guard: rubbing has no force_limit"):
        run(rubbing(), Options(force_guard=True))
    with pytest.raises(InputError, match="no force_limit"):
        check_request(RunRequest("hefting", options=Options(force_guard=True)))
    check_request(RunRequest("pinching", options=Options(force_guard=True)))
