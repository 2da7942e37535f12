"""Splines, planners and policies as pure functions of their arguments."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim.belief import Belief
from drake_cafim.design.planner import PLANNERS, PlannerConfig, Scored, around, best_index
from drake_cafim.design.policies import POLICIES, attainable, make_planner, make_policy
from drake_cafim.design.scores import InformationScore, OneStepScore
from drake_cafim.design.situation import Decision, Situation
from drake_cafim.design.splines import sample, shift
from drake_cafim.design.system import CaOed
from drake_cafim.errors import InputError
from drake_cafim.experiment.kinematic_world import kinematic_world
from drake_cafim.information import fisher_information
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing

BOUNDS = (np.array([-1.0, -1.0]), np.array([1.0, 1.0]))


def _situation(task, robot_state=None, step=0, knots=4):
    model = task.model
    robot = task.robot_start if robot_state is None else np.array(robot_state)
    motion = model.measured_motion(np.stack([robot, robot])[np.newaxis])[0, 0]
    return Situation(
        step=step,
        time=step * model.period,
        robot_state=robot,
        theta=model.parameters.mean,
        covariance=np.diag(model.parameters.std**2),
        information=Belief.prior(model.parameters).information,
        touched=model.start(motion, model.parameters.mean),
        knots=np.zeros((knots, len(robot) // 2)),
    )


def test_splines_go_through_their_knots_and_keep_a_constant():
    knots = np.random.default_rng(0).normal(size=(3, 4, 2))
    np.testing.assert_allclose(sample(knots, 10)[:, [0, 3, 6, 9]], knots, atol=1e-12)
    np.testing.assert_allclose(sample(np.ones((4, 2)), 10), 1.0)
    line = np.linspace(0.0, 1.0, 4)[:, np.newaxis]
    np.testing.assert_allclose(sample(line, 10)[:, 0], np.linspace(0.0, 1.0, 10), atol=1e-12)


def test_shifted_splines_start_one_sample_later():
    knots = np.random.default_rng(1).normal(size=(4, 2))
    before, after = sample(knots, 10), shift(knots, 10)
    np.testing.assert_allclose(after[0], before[1], atol=1e-12)
    np.testing.assert_allclose(after[-1], knots[-1])


def test_candidates_hold_the_nominal_first_and_stay_in_bounds():
    knots = around(np.full((4, 2), 0.2), 50, 1.0, BOUNDS, np.random.default_rng(2))
    np.testing.assert_array_equal(knots[0], 0.2)
    assert (np.abs(knots) <= 1.0).all() and (np.abs(knots) == 1.0).any()


def test_ties_are_broken_at_random():
    picks = {best_index(np.zeros(5), np.random.default_rng(seed)) for seed in range(60)}
    assert picks == set(range(5))
    assert best_index(np.array([0.0, 2.0, 1.0]), np.random.default_rng(0)) == 1


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_climb_a_smooth_score_within_their_budget(name):
    target = sample(np.array([[0.5, -0.6], [-0.4, 0.2], [0.6, 0.5], [0.0, -0.3]]), 10)
    used = []

    def score(commands):
        used.append(len(commands))
        value = -((commands - target) ** 2).sum(axis=(1, 2))
        return Scored(value, np.zeros((len(commands), 1, 1)))

    config = PlannerConfig(candidates=16, knot_std=0.3)
    planner, random = make_planner(name, config), np.random.default_rng(3)
    knots, scores = np.zeros((4, 2)), []
    for _ in range(25):
        plan = planner(knots, score, BOUNDS, random)
        knots = plan.knots
        scores.append(plan.scores.max())
        assert (np.abs(plan.commands) <= 1.0).all()
    assert max(used) <= 16 and sum(used) <= 25 * 16
    start = -(target**2).sum()
    assert (np.diff(scores) >= -1e-12).all(), "a plan worse than the nominal was taken"
    assert scores[-1] > 0.4 * start


def test_unknown_names_are_refused_with_the_valid_ones():
    with pytest.raises(InputError, match="predictive-sampling"):
        make_planner("rrt")
    with pytest.raises(InputError, match="contact-aware"):
        make_policy("greedy", hefting().model)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("make", [hefting, rubbing, pinching, contouring])
def test_every_policy_commands_every_task(make, policy):
    task = make()
    decide = make_policy(policy, task.model)
    first, again = (decide(_situation(task), np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first.plan, again.plan)
    lower, upper = task.model.velocity_bounds
    assert (first.command >= lower).all() and (first.command <= upper).all()
    assert first.plan.shape == (10, len(lower))


def test_score_is_information_less_cost():
    task = rubbing()
    model, situation = task.model, _situation(rubbing(), [0.035, 0.7, 0.0, 0.0])
    commands = np.array([[[0.0, 0.9]] * 10, [[0.0, 0.1]] * 10])
    scored = InformationScore(model, TangentEvaluator(model))(situation, commands)
    motion = model.motion(situation.robot_state, commands)
    rollout = TangentEvaluator(model)(motion, situation.theta, situation.touched)
    fisher = fisher_information(rollout.sensitivities, model.noise_std)
    np.testing.assert_array_equal(scored.fisher, fisher)
    assert fisher[0, 0, 0] > 0 and fisher[1, 0, 0] == 0  # sliding slowly tells nothing about friction
    prior = situation.information[0, 0]
    gain = 0.5 * np.log((prior + fisher[:, 0, 0]) / prior)
    np.testing.assert_allclose(scored.scores, gain - model.cost(rollout, situation.theta))


def test_one_step_reward_sees_states_and_no_forces():
    task = contouring()
    task = replace(task, model=replace(task.model, seeking=0.0))
    poke = np.full((1, 10, 2), 0.4)
    assert OneStepScore(task.model)(_situation(task, [0.5, -0.04, 0, 0]), poke).scores[0] <= 0.0
    soft = hefting(CompliantHefting(contact_weight=0.0, excess_weight=0.0))
    shaken, still = (OneStepScore(soft.model)(_situation(soft), np.full((1, 10, 1), v)).scores[0] for v in (0.9, 0.0))
    assert shaken > still > 0


def test_commands_are_what_the_robot_can_do():
    model = rubbing().model
    command = attainable(model, np.array([0.01, 0.7, 0.0, 0.0]), np.array([-1.0, 0.5]))
    np.testing.assert_allclose(command, [-0.5, 0.5])  # the wall of the workspace is half a step away


def test_random_policy_executes_a_spline_to_its_end():
    task = pinching()
    decide = make_policy("random", task.model)
    situation = _situation(task)
    first = decide(situation, np.random.default_rng(0))
    later = decide(replace(situation, step=3, knots=first.knots), np.random.default_rng(1))
    np.testing.assert_array_equal(later.plan[:7], first.plan[3:])
    fresh = decide(replace(situation, step=10, knots=first.knots), np.random.default_rng(1))
    assert not np.array_equal(fresh.knots, first.knots)


def test_system_has_its_documented_ports():
    task = contouring()
    system = CaOed(task.model, make_policy("contact-aware", task.model))
    inputs = {system.get_input_port(i).get_name(): system.get_input_port(i).size() for i in range(2)}
    assert inputs == {"measured_state": 4, "belief": 6}
    outputs = {
        system.get_output_port(i).get_name(): system.get_output_port(i).size() for i in range(system.num_output_ports())
    }
    assert outputs == {
        "command": 2,
        "plan": 20,
        "information": 4,
        "candidates": 200,
        "planning_ms": 1,
    }


class _Spy:
    """A policy that remembers what it was asked, and pokes with constant knots of its own."""

    shifts = True

    def __init__(self, command):
        self.config, self.command, self.asked = PlannerConfig(), np.array(command), []

    def __call__(self, situation, random):
        self.asked.append(situation)
        knots = np.linspace(0.0, 1.0, 4)[:, np.newaxis] * self.command
        plan = sample(knots, 10)
        return Decision(self.command, plan, knots, np.zeros_like(situation.information), plan[np.newaxis])


def _asked(beliefs, periods):
    """What a spy was asked while its commands squeeze; `beliefs` (periods, 6) are what CA-OED is told."""
    task = pinching()
    model, spy = task.model, _Spy([-0.1])
    builder = DiagramBuilder()
    world = builder.AddSystem(kinematic_world(task).system)
    design = builder.AddSystem(CaOed(model, spy))
    told = PiecewisePolynomial.ZeroOrderHold(model.period * (np.arange(periods + 1) - 0.1), beliefs.T)
    source = builder.AddSystem(TrajectorySource(told))
    builder.Connect(source.get_output_port(), design.GetInputPort("belief"))
    builder.Connect(world.GetOutputPort("measured_state"), design.GetInputPort("measured_state"))
    builder.Connect(design.GetOutputPort("command"), world.GetInputPort("command"))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((periods - 0.75) * model.period)
    return task, spy.asked


def test_system_starts_each_plan_from_the_last_one_shifted():
    prior = Belief.prior(pinching().model.parameters).vector()
    _, asked = _asked(np.tile(prior, (6, 1)), 5)
    np.testing.assert_array_equal(asked[0].knots, 0.0)
    expected = shift(np.linspace(0.0, 1.0, 4)[:, np.newaxis] * -0.1, 10)
    for situation in asked[1:]:
        np.testing.assert_allclose(situation.knots, expected)
    assert [situation.step for situation in asked] == list(range(5))


def test_system_counts_what_it_has_learned_until_the_belief_holds_it():
    prior = Belief.prior(pinching().model.parameters)
    renewed = Belief(prior.names, prior.mean, 0.5 * prior.covariance)
    beliefs = np.stack([prior.vector()] * 5 + [renewed.vector()] * 4)
    task, asked = _asked(beliefs, 8)
    told = [prior.information] * 5 + [renewed.information] * 3
    gained = [a.information - t for a, t in zip(asked, told, strict=True)]
    states = np.stack([a.robot_state for a in asked])[np.newaxis]
    rollout = TangentEvaluator(task.model)(states, prior.mean, asked[0].touched)
    per_step = [fisher_information(rollout.sensitivities[:, k : k + 1], task.model.noise_std)[0] for k in range(7)]
    assert np.abs(per_step[4]).max() > 0, "it touches nothing: no test"
    for step in range(5):
        np.testing.assert_allclose(gained[step], sum(per_step[:step], np.zeros((2, 2))), atol=1e-15)
    np.testing.assert_allclose(gained[5], 0.0, atol=1e-15)
    np.testing.assert_allclose(gained[7], per_step[5] + per_step[6], atol=1e-12)
