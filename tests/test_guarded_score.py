"""Scores of plans with a force guard: of the commands that the guard lets through."""

import numpy as np
import pytest

import drake_cafim.experiment.closed_loop
from drake_cafim.belief import Belief
from drake_cafim.design.force_belief import ForceBelief, condensed, first_force_belief, predicted_forces
from drake_cafim.design.force_guard import GuardConfig, guarded_commands
from drake_cafim.design.guarded_score import GuardedScore
from drake_cafim.design.planner import Scored
from drake_cafim.design.policies import make_policy
from drake_cafim.design.situation import Situation
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.pinching import pinching

LIMIT = 10.0


def situation(model, robot, forces):
    belief = Belief.prior(model.parameters)
    motion = np.array(robot)
    return Situation(
        step=0,
        time=0.0,
        robot_state=motion,
        theta=belief.mean,
        covariance=belief.covariance,
        information=belief.information,
        touched=model.start(motion, belief.mean),
        knots=np.zeros((4, len(motion) // 2)),
        forces=forces,
    )


@pytest.mark.parametrize("size", [1, 2])
def test_the_fewest_hypotheses_have_the_same_moments(size):
    random = np.random.default_rng(size)
    model = pinching().model
    old = ForceBelief(
        np.array([800.0, 10.0])[:size] + random.normal(size=(40, size)),
        random.normal(size=40),
        np.array([1.0, 0.0]) + 0.1 * random.normal(size=(40, 2)),
        np.tile([[0.02, 0.01], [0.01, 0.04]], (40, 1, 1)),
    )
    if size == 1:
        free, _ = model.parameters.free
        model = type(model)(parameters=type(model.parameters)((free,)))
    new = condensed(model, old)
    assert new.theta.shape == (size + 3, size)
    for before, after in ((old.theta, new.theta), (old.mean, new.mean)):
        mean = old.weight @ before
        np.testing.assert_allclose(after.mean(axis=0), mean)
        np.testing.assert_allclose(after.var(axis=0), old.weight @ (before - mean) ** 2, rtol=1e-5)
    np.testing.assert_allclose(new.covariance, np.broadcast_to(old.covariance[0], new.covariance.shape))


@pytest.mark.parametrize("task", [pinching(), contouring()], ids=lambda task: task.name)
def test_forces_of_all_hypotheses_at_once_are_those_of_each(task):
    model, random = task.model, np.random.default_rng(0)
    theta = first_force_belief(model, Belief.prior(model.parameters), GuardConfig().filter).theta
    nu = len(model.workspace_lower)
    positions = random.uniform(model.workspace_lower, model.workspace_upper, size=(30, 4, nu))
    states = np.concatenate([positions, random.normal(size=positions.shape)], axis=-1)
    together = predicted_forces(model, states, theta)
    assert np.any(together)
    each = [model.contact(np.zeros((30, 4, 0)), states, point) for point in theta]
    np.testing.assert_array_equal(together, each)


def test_commands_are_cut_together_as_they_are_alone():
    model, random = contouring().model, np.random.default_rng(2)
    belief = first_force_belief(model, Belief.prior(model.parameters), GuardConfig().filter)
    states = np.column_stack(
        [0.5 + random.uniform(-0.15, 0.15, 20), random.uniform(-0.12, 0.12, 20), np.zeros((20, 2))]
    )
    commands = random.uniform(-0.5, 0.5, size=(20, 2))
    together = guarded_commands(model, belief, states, commands, LIMIT, GuardConfig())
    assert 0 < np.any(together != commands, axis=1).sum() < 20
    for state, command, expected in zip(states, commands, together, strict=True):
        alone = guarded_commands(model, belief, state[np.newaxis], command[np.newaxis], LIMIT, GuardConfig())
        np.testing.assert_array_equal(alone[0], expected)


def test_what_is_scored_of_a_plan_keeps_the_limit_and_mild_plans_pass_whole():
    model = pinching().model
    theta = np.array([800.0, 10.0]) + 1e-6 * np.random.default_rng(0).normal(size=(6, 2))
    sure = ForceBelief(theta, np.zeros(6), np.tile([1.0, 0.0], (6, 1)), np.tile(1e-12 * np.eye(2), (6, 1, 1)))
    scored = []

    def score(where, commands):
        scored.append(commands)
        return Scored(np.zeros(len(commands)), np.zeros((len(commands), 2, 2)))

    guarded = GuardedScore(model, score, LIMIT)
    here = situation(model, [0.0215, 0.0], sure)
    press, mild, away = (np.full((10, 1), speed) for speed in (-0.3, -0.02, 0.1))
    plans = np.stack([press, mild, away])
    guarded(here, plans)
    np.testing.assert_array_equal(scored[0][1:], plans[1:])
    forces = []
    for commands in (plans, scored[0]):
        motion = model.motion(here.robot_state, commands)
        forces.append(predicted_forces(model, motion, theta)[0, ..., 0])
    assert forces[0][0].max() > LIMIT + 3.0
    assert 5.0 < forces[1][0].max() <= LIMIT


@pytest.mark.long
def test_a_planner_that_knows_of_the_guard_learns_more(monkeypatch):
    """Where what is touched is harder than believed, so that plans press and are stopped."""
    told, task = {}, pinching().with_prior_mean(0.7)
    for knows in (True, False):
        if not knows:
            monkeypatch.setattr(
                drake_cafim.experiment.closed_loop,
                "make_policy",
                lambda name, model, *, force_limit, **rest: make_policy(name, model, **rest),
            )
        results = [run(task, Options(seed=seed, experiments=2, force_guard=True)) for seed in range(3)]
        told[knows] = np.mean([experiment.scaled_trace for result in results for experiment in result.experiments])
    assert told[True] > 1.3 * told[False]


@pytest.mark.long
def test_a_first_touch_in_drakes_contact_keeps_the_limit_though_the_prior_is_too_low():
    """Of twenty seeds, this one's force grows the most from what is felt first to what comes next."""
    stage = stage_of(load(resolve("pinching")), "pinching")
    task = stage.task.with_prior_mean(0.7)
    result = run(task, Options(seed=13, experiments=1), stage.world("drake", 13))
    forces = result.experiments[0]
    assert forces.behaviour["contact_fraction"] > 0.4
    assert 7.0 < np.abs(forces.true_force).max() <= LIMIT
