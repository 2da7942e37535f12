"""Scores averaged over samples of the belief, and paired comparisons of planners by seed."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.belief import Belief
from drake_cafim.commands.run import RunRequest, check_request
from drake_cafim.design.averaging import BeliefAveragedScore
from drake_cafim.design.policies import make_policy
from drake_cafim.design.scores import InformationScore
from drake_cafim.design.sigma_points import sigma_points
from drake_cafim.design.situation import Situation
from drake_cafim.errors import InputError
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.studies.paired import paired_difference, paired_ratio
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.hefting import hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing


def _situation(task, robot_state, theta):
    model = task.model
    belief = Belief.prior(model.parameters)
    motion = model.measured_motion(np.stack([robot_state, robot_state])[np.newaxis])[0, 0]
    touched = model.start(motion, theta)
    knots = np.zeros((4, len(robot_state) // 2))
    return Situation(0, 0.0, np.array(robot_state), theta, belief.covariance, belief.information, touched, knots)


@pytest.mark.parametrize("size, count", [(1, 2), (1, 9), (2, 3), (2, 5), (3, 11), (4, 40)])
def test_points_have_the_moments_of_the_belief(size, count):
    random = np.random.default_rng(size)
    root = random.normal(size=(size, size))
    mean, covariance = random.normal(size=size), root @ root.T
    points = sigma_points(mean, covariance, count)
    np.testing.assert_allclose(points.mean(axis=0), mean, atol=1e-12)
    np.testing.assert_allclose(np.cov(points.T, bias=True).reshape(size, size), covariance, atol=1e-11)
    assert len(np.unique(points.round(9), axis=0)) == count


def test_friction_too_high_is_told_by_the_belief_where_the_mode_sees_nothing():
    """μ λ_n above R v_t is out of sight: a mode of 1.2 says so of a slow rub, the wide belief does not."""
    task = rubbing()
    situation = _situation(task, [0.02, 0.7, 0.0, 0.0], np.array([1.2]))
    rub = np.tile([0.0, 0.8], (1, 10, 1))
    mode = InformationScore(task.model, TangentEvaluator(task.model))
    averaged = BeliefAveragedScore(task.model, mode, 5)
    assert mode(situation, rub).fisher[0, 0, 0] == 0.0
    told = averaged(situation, rub)
    points = task.model.parameters.clip(sigma_points(situation.theta, situation.covariance, 5))
    expected = [mode(replace(situation, theta=point), rub) for point in points]
    assert told.fisher[0, 0, 0] > 0.0
    np.testing.assert_allclose(told.scores, np.mean([member.scores for member in expected], axis=0))
    np.testing.assert_allclose(told.fisher, np.mean([member.fisher for member in expected], axis=0))


@pytest.mark.long
def test_a_ball_at_rest_rests_for_every_mass():
    task = hefting(CompliantHefting())
    situation = _situation(task, [0.2, 0.0], np.array([0.05]))
    seen = []

    def score(situation, commands):
        seen.append((situation.theta, situation.touched.state))
        return InformationScore(task.model, TangentEvaluator(task.model))(situation, commands)

    BeliefAveragedScore(task.model, score, 3)(situation, np.zeros((1, 10, 1)))
    motion = task.model.measured_motion(np.array([[[0.2, 0.0], [0.2, 0.0]]]))[0, 0]
    assert len({float(theta[0]) for theta, _ in seen}) == 3
    for theta, state in seen:
        np.testing.assert_allclose(state, task.model.start(motion, theta).state, rtol=1e-9)


def test_counts_that_mean_nothing_are_refused():
    model = pinching().model
    with pytest.raises(InputError, match=r"--belief-samples 2: expected 1 .* or from 3"):
        make_policy("contact-aware", model, belief_samples=2)
    with pytest.raises(InputError, match="--belief-samples 0"):
        check_request(RunRequest("rubbing", options=Options(belief_samples=0)))
    check_request(RunRequest("rubbing", options=Options(belief_samples=5)))
    free = replace(model.parameters.free[0], std=np.inf)
    with pytest.raises(InputError, match="no prior"):
        make_policy("contact-aware", replace(model, parameters=type(model.parameters)((free,))), belief_samples=5)


def test_pairs_take_the_seeds_out():
    random = np.random.default_rng(0)
    seeds = random.lognormal(0.0, 2.0, 30)
    better = seeds * random.lognormal(0.5, 0.1, 30)
    gain = paired_ratio(better, seeds)
    assert 1.5 < gain.low <= gain.value <= gain.high < 1.8
    assert paired_ratio([0.0, 0.0], [0.0, 0.0]).value == 1.0
    mean, low, high = paired_difference(seeds + 1.0, seeds)
    assert low == pytest.approx(1.0) and mean == pytest.approx(1.0) and high == pytest.approx(1.0)
