"""The Fisher information is a sum over total derivatives: proofs by finite differences and closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drake_cafim.errors import InputError
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import ShootingConfig, solve
from drake_cafim.information import CRITERIA, criterion, fisher_information
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.finite_difference import predict
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import Rubbing, rubbing

BOTH = Parameters((Parameter("friction", 0.4, std=0.3), Parameter("stiffness", 100.0, std=30.0)))


def _motions():
    """A motion (1, T·substeps + 1, nr) in contact for each model, away from its kinks."""
    slow = 0.15 * np.sin(0.7 * np.arange(12))[:, np.newaxis]
    press = np.array([-0.05, 0.9]) * np.ones((8, 1))
    squeeze = np.concatenate([np.full((4, 1), -0.15), np.full((2, 1), 0.05)])
    poke = np.array([[0.0, 0.45]] * 2 + [[0.1, 0.1]] * 3)
    return {
        "hefting": (hefting(), [0.2, 0.0], slow),
        "compliant": (hefting(CompliantHefting()), [0.2, 0.0], slow),
        "rubbing": (rubbing(), [0.02, 0.6, 0.0, 0.0], press),
        "pinching": (pinching(), [0.018, 0.0], squeeze),
        "contouring": (contouring(), [0.5, -0.05, 0.0, 0.0], poke),
    }


def _rollout(name, theta=None):
    task, start, commands = _motions()[name]
    model = task.model
    motion = model.motion(np.array(start), commands[np.newaxis])
    theta = task.theta if theta is None else theta
    return model, motion, TangentEvaluator(model)(motion, theta, model.start(motion[0, 0], theta))


def _measured(model, motion, theta):
    return predict(model, motion, theta, model.start(motion[0, 0], theta).state).measurements[0]


def _negative_log_likelihood(model, motion, theta, data):
    residual = (data - _measured(model, motion, theta)) / model.noise_std
    return 0.5 * (residual**2).sum()


@pytest.mark.parametrize("name", list(_motions()))
def test_total_derivative_matches_central_differences(name):
    """The start is differentiated too: S_0 is the equilibrium's where what is touched rests on it."""
    model, motion, rollout = _rollout(name)
    theta = _motions()[name][0].theta
    G = rollout.sensitivities[0]
    assert np.abs(G).max() > 0
    for index in range(len(theta)):
        step = 1e-5 * theta[index]
        shift = np.eye(len(theta))[index] * step
        central = (_measured(model, motion, theta + shift) - _measured(model, motion, theta - shift)) / (2 * step)
        np.testing.assert_allclose(G[..., index], central, atol=1e-6 * np.abs(G[..., index]).max())


@pytest.mark.parametrize("name", list(_motions()))
def test_fisher_is_the_hessian_of_the_noiseless_negative_log_likelihood(name):
    model, motion, rollout = _rollout(name)
    theta = _motions()[name][0].theta
    data = _measured(model, motion, theta)
    fisher = fisher_information(rollout.sensitivities, model.noise_std)[0]
    steps = np.minimum(1e-5, 1e-3 * theta) if name in ("hefting", "compliant") else 1e-4 * theta

    def value(shift):
        return _negative_log_likelihood(model, motion, theta + shift, data)

    hessian = np.empty_like(fisher)
    for i, a in enumerate(np.diag(steps)):
        for j, b in enumerate(np.diag(steps)):
            hessian[i, j] = (value(a + b) - value(a - b) - value(b - a) + value(-a - b)) / (4 * a.sum() * b.sum())
    np.testing.assert_allclose(hessian, fisher, atol=1e-6 * np.abs(fisher).max())


@pytest.mark.parametrize("name", list(_motions()))
def test_additive_over_time_symmetric_positive_semidefinite(name):
    model, _, rollout = _rollout(name)
    G = rollout.sensitivities
    whole = fisher_information(G, model.noise_std)[0]
    parts = sum(fisher_information(G[:, k : k + 1], model.noise_std)[0] for k in range(G.shape[1]))
    np.testing.assert_allclose(parts, whole, rtol=1e-12, atol=1e-12 * np.abs(whole).max())
    np.testing.assert_array_equal(whole, whole.T)
    assert np.linalg.eigvalsh(whole).min() >= -1e-12 * np.abs(whole).max()


def test_friction_and_stiffness_from_the_tangential_force_alone_have_rank_one():
    """λ_t = μ K d: only the product is seen. With λ_n measured too, both are."""
    for measures_normal, rank in ((False, 1), (True, 2)):
        model = Rubbing(parameters=BOTH, measures_normal=measures_normal, damping=0.0)
        commands = np.array([[-0.1, 0.9]] * 4 + [[0.15, -0.95]] * 4)
        motion = model.motion(np.array([0.035, 0.7, 0.0, 0.0]), commands[np.newaxis])
        theta = BOTH.mean
        G = TangentEvaluator(model)(motion, theta, model.start(motion[0, 0], theta)).sensitivities
        # units differ: rank of the information in units of θ itself
        scaled = fisher_information(G * theta, model.noise_std)[0]
        assert np.linalg.matrix_rank(scaled, tol=1e-10 * np.trace(scaled)) == rank


def test_theorem_one_read_literally_gives_zero():
    """With τ and α fixed, −∂²L/∂θ² is not the information; with N = [dτ/dθ; I], −Nᵀ∇²L N is.

    Rigid hefting: τ = (λ_t), L = −½ Σ (y − λ)²/σ² + Σ α_t (λ_t − m (a_t + g)).
    """
    model, _, rollout = _rollout("hefting")
    sigma, count = model.noise_std[0], rollout.forces.shape[1]
    slope = rollout.sensitivities[0, :, 0, 0]  # dλ/dm = a + g
    # ∇²L over (λ_1 … λ_T, m): the data term is −1/σ² on λ; the constraint is linear in both, so ∂²L/∂m² = 0
    hessian = np.zeros((count + 1, count + 1))
    hessian[:count, :count] = -np.eye(count) / sigma**2
    literal = -hessian[count, count]
    assert literal == 0.0
    N = np.append(slope, 1.0)
    fisher = fisher_information(rollout.sensitivities, model.noise_std)[0, 0, 0]
    assert fisher > 1e3
    np.testing.assert_allclose(-N @ hessian @ N, fisher, rtol=1e-12)


def test_theorem_one_read_literally_is_negative_on_noisy_compliant_data():
    """Compliant: the step λ/m is curved in m, so the multipliers enter ∂²L/∂m² and noise gives it any sign.

    α solves the adjoint equations of the trajectory at the data; the projected Hessian's expectation is F.
    """
    task, start, commands = _motions()["compliant"]
    model, theta = task.model, task.theta
    motion = model.motion(np.array(start), commands[np.newaxis])
    fisher = fisher_information(
        TangentEvaluator(model)(motion, theta, model.start(motion[0, 0], theta)).sensitivities, model.noise_std
    )[0, 0, 0]
    literal = [_literal_information(model, motion[0], theta, seed) for seed in range(40)]
    assert min(literal) < 0 < max(literal)
    assert abs(np.mean(literal)) < 0.2 * fisher
    assert _literal_information(model, motion[0], theta, None) == pytest.approx(0.0, abs=1e-9)


def _literal_information(model, motion, theta, seed):
    """−∂²L/∂m² with trajectory and multipliers held fixed, for one noisy (or clean) set of measurements."""
    random = np.random.default_rng(seed)
    x = model.start(motion[0], theta).state
    forces, states, steps, contacts = [], [x], [], []
    for before, after in pairwise(motion):
        contacts.append(model.contact_jacobians(x, before, theta))
        forces.append(contacts[-1].value)
        steps.append(model.step_jacobians(x, before, after, forces[-1], theta))
        x = steps[-1].value
        states.append(x)
    contacts.append(model.contact_jacobians(x, motion[-1], theta))
    # adjoint p of the state: p_k = A_kᵀ p_{k+1} + (∂λ/∂x)ᵀ ∂ℓ/∂λ, with ℓ the log likelihood
    p, total = np.zeros(2), 0.0
    for k in range(len(motion) - 1, 0, -1):
        if k % model.substeps == 0:
            noise = 0.0 if seed is None else random.standard_normal()
            p = p + contacts[k].wrt_state[0] * noise / model.noise_std[0]
        h, force = model.period / model.substeps, forces[k - 1][0]
        curvature = 2.0 * force / theta[0] ** 3 * np.array([h * h, h])  # ∂²f/∂m²
        total += p @ curvature
        slope = steps[k - 1].wrt_state + steps[k - 1].wrt_force @ contacts[k - 1].wrt_state
        p = slope.T @ p
    return -total


@pytest.mark.parametrize("name", ["hefting", "rubbing", "pinching"])
def test_cramer_rao_on_a_fixed_trajectory(name):
    """Var(θ̂)·F within 0.80–1.25 and |bias| < 0.2 sd over 400 draws of the noise, with a nearly flat prior."""
    task, start, commands = _motions()[name]
    if name == "hefting":
        commands = np.tile(commands, (6, 1))
    elif name == "rubbing":
        commands = np.concatenate([[[-0.05, 0.9]] * 8, np.tile([[0.0, 0.9]] * 10 + [[0.0, -0.9]] * 10, (3, 1))])
        start = [0.02, 0.6, 0.0, 0.0]
    else:
        commands = np.tile(np.concatenate([commands, -commands]), (12, 1))
    flat = [
        replace(p, std=20 * p.std, mean=value) for p, value in zip(task.model.parameters.free, task.theta, strict=True)
    ]
    model = replace(task.model, parameters=Parameters.of(flat))
    motion = model.motion(np.array(start), commands[np.newaxis])
    states = motion[0][:, : len(start)]
    clean = _measured(model, motion, task.theta)
    random = np.random.default_rng(5)
    config = ShootingConfig(grid_points=3, starts=1, gauss_newton_steps=6)
    estimates, fisher = [], None
    for _ in range(400):
        noisy = clean + model.noise_std * random.standard_normal(clean.shape)
        problem = make_problem(model, TangentEvaluator(model), [Data(states, noisy)])
        fisher = problem.fisher(task.theta)[0]
        estimates.append(solve(problem, config).belief.mean)
    errors = np.array(estimates) - task.theta
    predicted = np.linalg.inv(fisher)
    ratio = np.diag(np.cov(errors.T).reshape(predicted.shape)) / np.diag(predicted)
    assert ((ratio > 0.80) & (ratio < 1.25)).all(), ratio
    assert (np.abs(errors.mean(axis=0)) < 0.2 * np.sqrt(np.diag(predicted))).all()


def test_counting_the_prior_twice_claims_too_little():
    """ℓ holds log p(θ) already: adding Σ⁻¹ again shrinks the interval below what the errors are."""
    task = hefting()
    problem_prior = task.model.parameters.std[0] ** -2
    fisher = 2 * problem_prior
    once, twice = 1 / (fisher + problem_prior), 1 / (fisher + 2 * problem_prior)
    random = np.random.default_rng(1)
    truth = random.normal(0.0, task.model.parameters.std[0], 4000)
    data = truth + random.normal(0.0, fisher**-0.5, 4000)
    error = fisher * data * once - truth
    assert np.var(error) * (1 / once) == pytest.approx(1.0, abs=0.05)
    assert np.var(error) * (1 / twice) > 1.25


def test_steepest_step_is_newton_on_hefting():
    """δθ = F⁻¹ ∇L from anywhere lands on the maximum likelihood, where the model is linear."""
    model, motion, rollout = _rollout("hefting")
    data = _measured(model, motion, np.array([0.05]))
    theta = np.array([0.08])
    residual = (data - _measured(model, motion, theta)) / model.noise_std
    gradient = (residual * rollout.sensitivities[0, :, :, 0] / model.noise_std).sum()
    fisher = fisher_information(rollout.sensitivities, model.noise_std)[0, 0, 0]
    np.testing.assert_allclose(theta + gradient / fisher, 0.05, rtol=1e-12)


def test_criteria_have_their_closed_forms():
    fisher = np.array([[[3.0, 1.0], [1.0, 2.0]], [[0.0, 0.0], [0.0, 0.0]]])
    prior = np.diag([2.0, 0.5])
    inverse = np.linalg.inv(prior)
    value = {name: criterion(name, fisher, prior) for name in CRITERIA}
    assert value["trace"][0] == pytest.approx(5.0)
    assert value["scaled_trace"][0] == pytest.approx(np.trace(inverse @ fisher[0]))
    logdet = 0.5 * (np.linalg.slogdet(prior + fisher[0])[1] - np.linalg.slogdet(prior)[1])
    assert value["logdet"][0] == pytest.approx(logdet)
    left = np.trace(prior @ np.linalg.inv(prior + fisher[0]))
    assert value["a_optimal"][0] == pytest.approx(2 - left)
    assert value["min_eigenvalue"][0] == pytest.approx(np.linalg.eigvals(inverse @ fisher[0]).real.min())
    for name in CRITERIA:
        assert value[name][1] == pytest.approx(0.0)
        single = criterion(name, fisher[:, :1, :1], prior[:1, :1])
        wide = criterion(name, np.array([[[3.0, 0.0], [0.0, 3.0]]]), np.diag([2.0, 2.0]))
        assert single[0] == pytest.approx(wide[0] / (1.0 if name == "min_eigenvalue" else 2.0))


def test_criteria_but_the_trace_do_not_depend_on_units():
    random = np.random.default_rng(2)
    G = random.normal(size=(4, 6, 3, 2))
    fisher, prior = fisher_information(G, np.ones(3)), np.diag([3.0, 0.2])
    units = np.diag([1e3, 1e-2])
    for name in CRITERIA:
        before, after = criterion(name, fisher, prior), criterion(name, units @ fisher @ units, units @ prior @ units)
        assert np.allclose(before, after) == (name != "trace")


def test_an_unknown_criterion_is_refused_with_the_valid_names():
    with pytest.raises(InputError, match="a_optimal"):
        criterion("d_optimal", np.eye(2), np.eye(2))
