"""CA-MAP: known parameters are recovered, from bad starts too; both programs have the same optimum."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import Solve

from drake_cafim.belief import Belief
from drake_cafim.errors import InputError
from drake_cafim.estimation.joint import build_joint_program, solve_joint
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import ShootingConfig, build_program, solve
from drake_cafim.sensitivity.finite_difference import predict
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing

TASKS = {"hefting": hefting, "rubbing": rubbing, "pinching": pinching, "contouring": contouring}


def slow_pokes(time, robot_state, theta):
    """Pokes that press for several samples, so that few of them lie at the kink where touch begins."""
    for until, velocity in ((1.0, (0, 0.08)), (2.0, (0, -0.08)), (2.5, (0.3, 0)), (3.0, (0, 0.2)), (4.0, (-0.09, 0))):
        if time < until - 1e-9:
            return np.array(velocity, dtype=float)
    return np.zeros(2)


def scripted_data(task, noise=1.0, seed=0, periods=None, experiments=1):
    """What the task's script measures in the model's own world, with noise."""
    model, random = task.model, np.random.default_rng(seed)
    script = slow_pokes if task.name == "contouring" else model.script
    result = []
    for _ in range(experiments):
        states = [task.robot_start]
        for k in range(periods or task.periods):
            command = script(k * model.period, states[-1], task.theta)
            following = model.motion(states[-1], command[np.newaxis, np.newaxis])[0, -1]
            states.append(following[: len(task.robot_start)])
        states = np.array(states)
        motion = model.measured_motion(states[np.newaxis])
        start = model.start(motion[0, 0], task.theta)
        clean = predict(model, motion, task.theta, start.state).measurements[0]
        result.append(Data(states, clean + noise * model.noise_std * random.standard_normal(clean.shape)))
    return result


def problem_of(task, data):
    return make_problem(task.model, TangentEvaluator(task.model), data)


@pytest.mark.parametrize("name", TASKS)
def test_the_truth_comes_back_from_clean_data(name):
    task = TASKS[name]()
    estimate = solve(problem_of(task, scripted_data(task, noise=0.0)))
    assert estimate.solved, estimate.message
    # what remains is the pull of the prior, Σ⁺ Σ₀⁻¹ (θ₀ − θ)
    prior = Belief.prior(task.model.parameters)
    pulled = estimate.belief.covariance @ prior.information @ (prior.mean - task.theta)
    assert (np.abs(estimate.belief.mean - task.theta - pulled) < 0.05 * estimate.belief.std).all()
    assert (estimate.belief.std < task.model.parameters.std).all()


def test_a_prior_that_predicts_no_contact_is_left():
    task = contouring().with_prior_mean(0.35)
    data = scripted_data(contouring(), experiments=8)
    problem = problem_of(task, data)
    assert (np.concatenate(problem.predictions(task.model.parameters.mean)) == 0).all(), "it touches: no test"
    estimate = solve(problem)
    np.testing.assert_allclose(estimate.belief.mean, task.theta, rtol=0.1)


def test_cost_gradient_is_that_of_the_cost():
    task = pinching()
    problem = problem_of(task, scripted_data(task))
    theta = 1.1 * task.theta
    cost, gradient = problem.cost_and_gradient(theta)
    assert cost == pytest.approx(problem.cost(theta), rel=1e-12)
    for index, step in enumerate(1e-5 * theta):
        shift = np.eye(len(theta))[index] * step
        difference = (problem.cost(theta + shift) - problem.cost(theta - shift)) / (2 * step)
        assert gradient[index] == pytest.approx(difference, rel=1e-6)


def test_linear_gaussian_case_has_its_closed_form():
    """Rigid hefting is linear in the mass, so that the MAP is a ratio of sums and Σ⁺ is exact."""
    task = hefting()
    data = scripted_data(task, experiments=3)
    estimate = solve(problem_of(task, data))
    slope = np.concatenate([task.model.measured_motion(d.robot_states[np.newaxis])[0, 1:, 2] + 9.81 for d in data])
    force = np.concatenate([d.measurements[:, 0] for d in data])
    prior, weight = task.model.parameters, 1 / 0.5**2
    precision = weight * slope @ slope + prior.std[0] ** -2
    mean = (weight * slope @ force + prior.mean[0] * prior.std[0] ** -2) / precision
    np.testing.assert_allclose(estimate.belief.mean, mean, rtol=1e-6)
    np.testing.assert_allclose(estimate.belief.covariance, 1 / precision, rtol=1e-9)
    np.testing.assert_allclose(estimate.fisher.sum(), weight * slope @ slope, rtol=1e-9)


def test_recursive_updating_gives_the_batch():
    task = hefting()
    data = scripted_data(task, experiments=2)
    batch = solve(problem_of(task, data)).belief
    first = solve(problem_of(task, data[:1])).belief
    model = task.model
    second = solve(make_problem(model, TangentEvaluator(model), data[1:], prior=first)).belief
    np.testing.assert_allclose(second.mean, batch.mean, rtol=1e-5)
    np.testing.assert_allclose(second.covariance, batch.covariance, rtol=1e-9)


def test_the_estimate_is_what_the_program_returned_and_users_may_add_to_it():
    task = hefting()
    problem = problem_of(task, scripted_data(task))
    program, z, to_theta = build_program(problem)
    alone = to_theta(Solve(program, np.zeros(1)).GetSolution(z))
    np.testing.assert_allclose(solve(problem).belief.mean, alone, rtol=1e-5)
    program.AddLinearConstraint(z[0] >= 1.0)
    bound = Solve(program, np.array([1.5]))
    np.testing.assert_allclose(to_theta(bound.GetSolution(z)), to_theta(np.ones(1)), rtol=1e-6)


def test_missing_measurements_count_for_nothing():
    task = pinching()
    (data,) = scripted_data(task)
    holed = data.measurements.copy()
    holed[10:30] = np.nan
    some, whole = (solve(problem_of(task, [Data(data.robot_states, y)])) for y in (holed, data.measurements))
    assert np.isfinite(some.belief.mean).all()
    assert (some.belief.std > whole.belief.std).all()


def test_experiments_of_different_length_keep_their_place():
    task = pinching()
    data = [
        *scripted_data(task, periods=20),
        *scripted_data(task, periods=50),
        *scripted_data(task, periods=20, seed=3),
    ]
    problem = problem_of(task, data)
    fisher = problem.fisher(task.theta)
    for place, single in enumerate(data):
        np.testing.assert_allclose(fisher[place], problem_of(task, [single]).fisher(task.theta)[0])
    assert [len(p) for p in problem.predictions(task.theta)] == [20, 50, 20]
    with pytest.raises(InputError, match="one robot state more"):
        Data(data[0].robot_states, data[0].robot_states)


def test_estimate_on_a_bound_says_so():
    task = rubbing()
    data = scripted_data(replace(task, truth={"friction": 0.0}), noise=0.0)
    problem = problem_of(task.with_prior_mean(0.0), data)
    assert solve(problem).on_bound == ("friction",)


def test_joint_program_has_the_optimum_of_shooting_on_hefting():
    task = hefting()
    problem = problem_of(task, scripted_data(task, experiments=2))
    shooting = solve(problem)
    joint = solve_joint(problem, problem.prior.mean)
    assert joint.solved, joint.message
    assert joint.violation < 1e-6
    np.testing.assert_allclose(joint.theta, shooting.belief.mean, rtol=1e-5)
    assert joint.cost == pytest.approx(shooting.cost, rel=1e-6)


@pytest.mark.parametrize("solver", ["snopt", "ipopt"])
def test_joint_program_has_the_optimum_of_shooting_on_compliant_hefting(solver):
    model = CompliantHefting(smoothing=0.01, substeps=10)
    task = hefting(model)
    data = scripted_data(task, periods=12)
    problem = problem_of(task, data)
    shooting = solve(problem, ShootingConfig(grid_points=5))
    joint = solve_joint(problem, 1.02 * shooting.belief.mean, solver)
    assert joint.solved, joint.message
    assert joint.violation < 1e-5
    np.testing.assert_allclose(joint.theta, shooting.belief.mean, rtol=1e-4)
    assert joint.cost == pytest.approx(shooting.cost, rel=1e-5)


def test_joint_program_has_a_variable_for_every_state_and_force():
    task = hefting(CompliantHefting(smoothing=0.01, substeps=4))
    problem = problem_of(task, scripted_data(task, periods=3))
    joint = build_joint_program(problem)
    assert joint.states[0].shape == (13, 2) and joint.forces[0].shape == (13, 1)
    assert joint.program.num_vars() == 1 + 13 * 3
    with pytest.raises(InputError, match="ipopt"):
        solve_joint(problem, problem.prior.mean, "newton")


def test_prior_belief_round_trips_through_a_vector():
    belief = Belief.prior(pinching().model.parameters)
    again = Belief.from_vector(belief.names, belief.vector())
    np.testing.assert_array_equal(again.covariance, belief.covariance)
