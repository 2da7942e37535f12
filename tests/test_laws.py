"""A belief over contact laws: evidence, odds, what plans tell apart, and a run that finds its law wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import norm

from drake_cafim.belief import Belief, LawBelief
from drake_cafim.commands.run import RunRequest, check_request, load_stage, planned_task
from drake_cafim.contact.edge import wedge_volume
from drake_cafim.design.law_scores import LawAveragedScore, expected_log_bayes_factor
from drake_cafim.design.scores import InformationScore
from drake_cafim.design.situation import Hypothesis, Situation
from drake_cafim.errors import InputError
from drake_cafim.estimation.evidence import log_evidence
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.experiment.run_record import run_record
from drake_cafim.information import without_nuisance
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.finite_difference import predict
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.task import Task


@pytest.fixture(scope="module")
def pinching() -> Task:
    stage = load_stage("pinching")
    return stage.with_laws(stage.task.with_prior_mean(1.3), "all")


def _squeezes(task: Task, law: str, seed: int, count: int = 3) -> list[Data]:
    """Data of quick squeezes, deep and shallow, under the law `law` at its true parameters."""
    candidate = next(each for each in task.candidates if each.law == law)
    model, random = candidate.model, np.random.default_rng(seed)
    commands = 0.25 * np.sin(np.linspace(0.0, 18.0, 50) + random.uniform(0.0, 0.3, (count, 1)))[..., np.newaxis]
    motion = model.motion(
        task.robot_start, -np.abs(commands) * np.sign(np.sin(np.linspace(0.0, 9.0, 50)))[:, np.newaxis]
    )
    theta = model.parameters.vector(candidate.truth)
    clean = predict(model, motion, theta, np.zeros(0)).measurements
    noisy = clean + model.noise_std * random.standard_normal(clean.shape)
    return [Data(states, readings) for states, readings in zip(motion, noisy, strict=True)]


def test_the_evidence_is_the_integral_over_the_parameters(pinching: Task) -> None:
    data = _squeezes(pinching, "hydroelastic", 1, count=1)
    for candidate in pinching.candidates:
        model = candidate.model
        problem = make_problem(model, TangentEvaluator(model), data)
        found = solve(problem)
        mean, std, prior = found.belief.mean, found.belief.std, problem.prior
        lower, upper = model.parameters.bounds
        low, high = np.maximum(mean - 8.0 * std, lower), np.minimum(mean + 8.0 * std, upper)
        least = problem.cost(mean)
        integral, _ = dblquad(
            lambda b, a: np.exp(least - problem.cost(np.array([a, b]))),  # noqa: B023
            low[0], high[0], low[1], high[1], epsabs=0.0, epsrel=1e-3,
        )  # fmt: skip
        inside = np.prod(norm.cdf(upper, prior.mean, prior.std) - norm.cdf(lower, prior.mean, prior.std))
        exact = np.log(integral / (2.0 * np.pi * np.prod(prior.std) * inside)) - least
        assert abs(log_evidence(problem, found) - exact) < 0.1, candidate.law


@pytest.mark.parametrize("law", ["kelvin_voigt", "hydroelastic"])
def test_the_law_of_the_data_is_the_most_probable(pinching: Task, law: str) -> None:
    data = _squeezes(pinching, law, 2, count=8)
    evidence = {}
    for candidate in pinching.candidates:
        problem = make_problem(candidate.model, TangentEvaluator(candidate.model), data)
        evidence[candidate.law] = log_evidence(problem, solve(problem))
    others = [value for name, value in evidence.items() if name != law]
    assert evidence[law] > max(others) + np.log(20.0)


def test_a_belief_over_laws_is_a_vector_and_back() -> None:
    beliefs = (Belief(("a",), np.array([1.0]), np.eye(1)), Belief(("b", "c"), np.array([2.0, 3.0]), np.eye(2)))
    over = LawBelief(("first", "second"), beliefs, np.array([-3.0, 1.0]))
    again = LawBelief.from_vector(over.laws, over.names, over.vector())
    np.testing.assert_array_equal(again.vector(), over.vector())
    assert over.best == 1 and again.beliefs[1].names == ("b", "c")
    np.testing.assert_allclose(over.probability, np.exp([-4.0, 0.0]) / (1.0 + np.exp(-4.0)))
    single = LawBelief(("",), beliefs[:1], np.zeros(1))
    np.testing.assert_array_equal(single.vector(), beliefs[0].vector())


def _hypotheses(task: Task, probabilities: list[float]) -> tuple[Hypothesis, ...]:
    found = []
    for candidate, probability in zip(task.candidates, probabilities, strict=True):
        belief = Belief.prior(candidate.model.parameters)
        start = candidate.model.start(task.robot_start, belief.mean)
        found.append(Hypothesis(candidate.law, probability, belief.mean, belief.covariance, belief.information, start))
    return tuple(found)


def test_the_expected_bayes_factor_is_that_of_the_predictive_distributions(pinching: Task) -> None:
    """Against the dense ½ rᵀ S⁻¹ r."""
    first, second = (_hypotheses(pinching, [0.25] * 4)[k] for k in (0, 3))
    models = {candidate.law: candidate.model for candidate in pinching.candidates}
    commands = np.random.default_rng(3).uniform(-0.3, 0.3, (5, 10, 1))
    rollouts = []
    for hypothesis in (first, second):
        model = models[hypothesis.law]
        motion = model.motion(pinching.robot_start, commands)
        rollouts.append(TangentEvaluator(model)(motion, hypothesis.theta, hypothesis.touched))
    noise_std = models["kelvin_voigt"].noise_std
    found = expected_log_bayes_factor((first, rollouts[0]), (second, rollouts[1]), noise_std)
    for k in range(5):
        r = (rollouts[0].measurements[k] - rollouts[1].measurements[k]).ravel()
        S = noise_std[0] ** 2 * np.eye(len(r))
        for hypothesis, rollout in zip((first, second), rollouts, strict=True):
            G = rollout.sensitivities[k].reshape(len(r), -1)
            S = S + G @ hypothesis.covariance @ G.T
        np.testing.assert_allclose(found[k], 0.5 * r @ np.linalg.solve(S, r), rtol=1e-9)
    assert found.max() > 0.0


def test_plans_for_one_certain_law_are_those_of_that_law(pinching: Task) -> None:
    models = {candidate.law: candidate.model for candidate in pinching.candidates}
    scores = {law: InformationScore(model, TangentEvaluator(model)) for law, model in models.items()}
    hypotheses = _hypotheses(pinching, [0.0, 0.0, 0.0, 1.0])
    sure = hypotheses[3]
    situation = Situation(
        0, 0.0, pinching.robot_start, hypotheses[0].theta, hypotheses[0].covariance, hypotheses[0].information,
        hypotheses[0].touched, np.zeros((4, 1)), hypotheses=hypotheses,
    )  # fmt: skip
    commands = np.random.default_rng(3).uniform(-0.3, 0.3, (5, 10, 1))
    alone = replace(
        situation, theta=sure.theta, covariance=sure.covariance, information=sure.information, touched=sure.touched
    )
    np.testing.assert_allclose(
        LawAveragedScore(scores)(situation, commands).scores, scores["hydroelastic"](alone, commands).scores
    )


def test_a_nuisance_is_projected_out() -> None:
    """The information about the rest is the inverse of its block of the covariance."""
    random = np.random.default_rng(0)
    root, slopes = random.normal(size=(4, 4)), random.normal(size=(3, 7, 4))
    prior, fisher = root @ root.T, np.swapaxes(slopes, -1, -2) @ slopes
    sought = np.array([True, False, True, False])
    counted, before = without_nuisance(fisher, prior, sought)
    rows = np.ix_(sought, sought)
    np.testing.assert_allclose(np.linalg.inv(before), np.linalg.inv(prior)[rows])
    for k in range(3):
        np.testing.assert_allclose(np.linalg.inv(before + counted[k]), np.linalg.inv(prior + fisher[k])[rows])


def test_a_run_tells_its_odds_and_the_estimate_of_the_best_law(pinching: Task) -> None:
    result = run(replace(pinching, periods=20), Options(seed=1, experiments=2))
    record = run_record(result, ["1", "2"], {"replay": "", "figures": []})
    for experiment in record["experiments"]:
        assert set(experiment["laws"]) == {"kelvin_voigt", "paper", "hunt_crossley", "hydroelastic"}
        assert experiment["laws"][experiment["law"]] == max(experiment["laws"].values())
        names = record["candidates"][experiment["law"]]["truth"]
        assert set(experiment["estimate"]) == set(experiment["error_percent"]) == set(names)
    own = run(replace(pinching, periods=20).with_law("hunt_crossley"), Options(seed=1, experiments=1))
    assert "laws" not in run_record(own, ["1"], {})["experiments"][0]


def test_a_law_that_the_scenario_lacks_is_refused(pinching: Task) -> None:
    with pytest.raises(InputError, match="--law glue: pinching has the laws all, kelvin_voigt"):
        pinching.with_law("glue")


def test_the_place_of_a_contact_is_learned(pinching: Task) -> None:
    """With the surface 2 mm nearer than planned: the stiffness as in place, and the offset found."""
    task = pinching.with_law("kelvin_voigt").with_unknown_place(3e-3)
    assert task.model.parameters.names == ("stiffness", "damping", "offset")
    data = _squeezes(pinching, "kelvin_voigt", 4, count=10)
    shifted = [Data(each.robot_states + np.array([2e-3, 0.0]), each.measurements) for each in data]
    found = solve(make_problem(task.model, TangentEvaluator(task.model), shifted)).belief
    assert abs(found.mean[2] - 2e-3) < 3.0 * found.std[2] < 2e-3
    assert abs(found.mean[0] - 800.0) < 3.0 * found.std[0]


def test_the_volume_nearest_to_a_face_is_that_of_a_sampled_ball() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (400_000, 3))
    points = points[(points**2).sum(axis=1) < 1.0]
    beyond = np.random.default_rng(1).uniform(-2.5, 1.2, (40, 2))
    volume, by_first, by_second = wedge_volume(beyond[:, 0], beyond[:, 1])
    for (a, b), found in zip(beyond, volume, strict=True):
        share = ((points[:, 0] < -a) & (points[:, 0] - points[:, 1] > b - a)).mean()
        assert abs(found - 4.0 / 3.0 * np.pi * share) < 0.02
    step = 1e-6
    for column, exact in ((0, by_first), (1, by_second)):
        shift = step * np.eye(2)[column]
        ahead, behind = (wedge_volume(*(beyond + sign * shift).T)[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind) / (2.0 * step), exact, atol=1e-5)


def test_parameters_say_which_are_sought() -> None:
    parameters = Parameters((Parameter("a", 1.0), Parameter("b", 1.0, nuisance=True), Parameter("c", 1.0, frozen=True)))
    assert parameters.sought.tolist() == [True, False]


def test_as_printed_has_the_papers_choices() -> None:
    for name in ("hefting", "rubbing", "pinching", "contouring"):
        stage = load_stage(name)
        request = RunRequest(name, as_printed=True)
        model = planned_task(stage, request).model
        assert model.law == "paper" and getattr(model, "seeking", 0.0) == 0.0
        assert request.chosen.criterion == "trace" and request.chosen.force_guard is False
        assert name != "hefting" or model.damping == 0.0
        assert name != "pinching" or model.parameters.std.tolist() == [10.0, np.sqrt(10.0)]
    with pytest.raises(InputError, match="--as-printed --law all"):
        check_request(RunRequest("pinching", as_printed=True, law="all"))
