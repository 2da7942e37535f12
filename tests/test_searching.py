"""What an experiment did not find is noticed, with an interval that says so, and searched for."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drake_cafim.belief import Belief, not_found
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.estimation.support import with_moments
from drake_cafim.experiment.closed_loop import MOST_SEARCHES, Options, run
from drake_cafim.experiment.run_record import run_record
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.contouring import contouring


def problem_along(task, positions, seed=0):
    """The problem of one slow motion along `positions` (k, 2) m, 20 periods from each to the next, with noise."""
    model, legs = task.model, []
    for first, second in pairwise(positions):
        legs.append(np.linspace(first, second, 20, endpoint=False))
    places = np.concatenate(legs)
    states = np.column_stack([places, np.gradient(places, model.period, axis=0)])
    clean = model.contact(np.zeros((len(states) - 1, 0)), states[1:], task.theta)
    noise = np.random.default_rng(seed).normal(size=clean.shape)
    return make_problem(model, TangentEvaluator(model), [Data(states, clean + model.noise_std * noise)])


@pytest.mark.parametrize("name", ["rubbing", "pinching", "contouring"])
def test_the_costs_of_many_points_are_those_of_each(name):
    stage = stage_of(load(resolve(name)), name)
    task = stage.with_laws(stage.task, "all").with_unknown_place(0.003)
    random, axes = np.random.default_rng(1), len(stage.task.robot_start) // 2
    for candidate in task.candidates:
        model, parameters = candidate.model, candidate.model.parameters
        states = np.tile(task.robot_start, (31, 1)) + 0.02 * random.normal(size=(31, 2 * axes))
        states[:, :axes] = np.clip(states[:, :axes], model.workspace_lower, model.workspace_upper)
        states[:, 0] *= np.linspace(1.0, 0.05 if name == "rubbing" else 0.8, 31)
        data = [Data(states, random.normal(size=(30, len(model.noise_std))))] * 2
        problem = make_problem(model, TangentEvaluator(model), data)
        points = [parameters.clip(parameters.mean + parameters.std * random.normal(size=len(parameters.names)))
                  for _ in range(20)]  # fmt: skip
        each = [problem.cost(point) for point in points]
        assert np.ptp(each) > 0
        np.testing.assert_allclose(problem.costs(np.array(points)), each, rtol=1e-12)


def test_what_was_not_touched_has_the_interval_of_where_no_contact_was():
    task = contouring()
    task = replace(task, model=task.with_prior_mean(1.5).model)
    past_the_end = [(0.5, -0.1), (0.59, -0.1), (0.59, 0.0), (0.59, 0.1)]
    prior, misled, wide = Belief.prior(task.model.parameters), 0, []
    truth = np.array([task.truth["length"], task.truth["width"]])
    for seed in range(5):
        problem = problem_along(replace(task, model=contouring().model), past_the_end, seed)
        problem = replace(problem, model=task.model, prior=prior)
        estimate = solve(problem)
        open_ = with_moments(problem, estimate).belief
        misled += abs(estimate.belief.mean[0] - truth[0]) > 1.96 * estimate.belief.std[0]
        wide.append(abs(open_.mean[0] - truth[0]) < 1.96 * open_.std[0])
        assert "length" in not_found(prior, open_, np.array([True, True]))
        # as integrated more finely, by the same law
        sizes = np.linspace(0.01, 0.28, 120)
        fine = np.array([[length, width] for length in sizes for width in np.linspace(0.01, 0.17, 60)])
        weight = np.exp(-problem.costs(fine) + problem.costs(fine).min())
        mean = weight @ fine / weight.sum()
        std = np.sqrt(weight @ (fine - mean) ** 2 / weight.sum())
        assert (np.abs(open_.mean - mean) < 0.2 * std).all()
        np.testing.assert_allclose(open_.std, std, rtol=0.2)
    assert misled >= 3, "the mode's own interval holds the truth: no test"
    assert np.mean(wide) >= 0.9


def test_what_was_touched_keeps_its_estimate():
    task = contouring()
    width = [(0.5, -0.1), (0.5, -0.02), (0.5, -0.02), (0.5, -0.1)]  # 1.5 cm deep for a second
    around = [*width, (0.6, -0.1), (0.6, 0.0), (0.558, 0.0), (0.558, 0.0)]
    problem = problem_along(task, around)
    estimate = solve(problem)
    assert with_moments(problem, estimate) is estimate
    prior = Belief.prior(task.model.parameters)
    assert not_found(prior, estimate.belief, np.array([True, True])) == ()


@pytest.mark.parametrize("name, scale", [("length", 1.5), ("length", 0.7), ("width", 1.5), ("width", 0.6)])
def test_the_approach_goes_round_the_box(name, scale):
    model, axis = contouring().model, ("length", "width").index(name)
    theta = scale * contouring().theta
    for start in ([0.5, -0.1], [0.45, 0.09], [0.35, 0.0]):
        state = np.array([*start, 0.0, 0.0])
        for _ in range(200):
            command = model.approach(name, state, theta, np.array([0.03, 0.03]))
            if command is None:
                break
            state = model.motion(state, command[np.newaxis, np.newaxis])[0, -1]
            away = np.abs(state[:2] - model.centre)
            facing = away[1 - axis] < 0.5 * theta[1 - axis]
            assert facing or model.distance(state, theta) > 0.0, "it runs into the box on its way"
        else:
            pytest.fail("it does not arrive")
        assert facing
        force = np.abs(model.contact(np.zeros(0), state, theta))
        assert 0.0 < force[axis] < model.force_limit and force[1 - axis] == 0.0


def test_a_run_that_found_nothing_searches():
    task = replace(contouring().with_prior_mean(1.5), periods=8)
    result = run(task, Options(seed=1))
    assert [experiment.searching for experiment in result.experiments] == [False] + MOST_SEARCHES * [True]
    first, last = result.experiments[0], result.experiments[-1]
    assert set(first.not_found) == {"length", "width"} and "between" in first.not_found["length"]
    record = run_record(result, ["a.parquet", "b.parquet", "c.parquet"], {})
    assert record["experiments"][0]["not_found"] == dict(first.not_found)
    assert [row["searching"] for row in record["experiments"]] == [False, True, True]
    assert last.robot_states[-1, 0] > 0.6, "on its way to an end of the box"
    assert len(run(task, Options(policy="random", seed=1)).experiments) == 1


@pytest.mark.long
def test_a_face_that_was_not_found_is_found():
    task = contouring()
    task = replace(task, model=replace(task.model, workspace_upper=(0.7, 0.15))).with_prior_mean(1.5)
    result = run(task, Options(seed=7, force_guard=True))
    first, last = result.experiments[0], result.experiments[-1]
    assert set(first.not_found) == {"length"} and abs(first.error_percent["length"]) > 30.0
    assert not last.not_found and abs(last.error_percent["length"]) < 15.0


@pytest.mark.long
def test_no_run_is_lost():
    """From a prior 50 % too high, behind the guard, a third of the runs touch no end of the box at first."""
    task = contouring()
    task = replace(task, model=replace(task.model, workspace_upper=(0.7, 0.15))).with_prior_mean(1.5)
    ends = [run(task, Options(seed=seed, force_guard=True)).experiments[-1] for seed in range(40)]
    assert not any(end.not_found for end in ends)
    errors = np.abs([list(end.error_percent.values()) for end in ends])
    assert (np.percentile(errors, 95, axis=0) <= 15.0).all(), np.percentile(errors, 95, axis=0)
