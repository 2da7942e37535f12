"""Tests of the paper's mathematical remarks (Fisher information, step, condition number, saltation), without runs."""

import numpy as np

from drake_cafim.estimation.problem import Data, MapProblem, make_problem
from drake_cafim.information import fisher_information
from drake_cafim.numerics.rounding import short
from drake_cafim.parameters import Parameter
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.finite_difference import FiniteDifferenceEvaluator
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.studies.findings import Claim
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.hefting import TRUE_MASS, hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import TRUE_FRICTION, Rubbing
from drake_cafim.typing import Array


def aside_claims() -> list[Claim]:
    """Claims on Theorem 1, the step F⁻¹∇L, the bound on the condition number, saltation, co-dependent parameters."""
    return [_literal_theorem(), _steepest_step(), _condition_bound(), _saltation(), *_codependent()]


def _commands(axes: int, steps: int, speed: float, seed: int) -> Array:
    """Random commands (1, steps, axes), each held for five steps."""
    draws = np.random.default_rng(seed).uniform(-speed, speed, (1, -(-steps // 5), axes))
    return np.repeat(draws, 5, axis=1)[:, :steps]


def _literal_theorem() -> Claim:
    """−∂²L/∂θ² with τ and α fixed is Σ g_θᵀ Σ⁻¹ g_θ: with partial derivatives, not total ones along the motion."""
    task = hefting()
    model, theta = task.model, task.theta
    motion = model.motion(task.robot_start, _commands(1, 60, 1.0, 1))
    rollout = TangentEvaluator(model)(motion, theta, model.start(motion[0, 0], theta))
    direct = model.measurement_jacobians(rollout.states[:, 1:], motion[:, 1:], rollout.forces, theta).wrt_parameters
    total = float(fisher_information(rollout.sensitivities, model.noise_std)[0, 0, 0])
    literal = float(np.sum((np.asarray(direct) / model.noise_std) ** 2))
    return _claim(
        "F = −∇²L with τ and the multipliers fixed (Theorem 1 as printed)",
        f"hefting: {short(literal, 3)} for the mass, while the total derivative gives {short(total, 3)}",
        bool(np.isclose(literal, total, rtol=1e-3)),
    )


def _steepest_step() -> Claim:
    """The decrease of the cost from the prior's mean by δθ = F⁻¹∇L, and by the best step along the gradient."""
    task = pinching()
    model, theta = task.model, task.theta
    motion = model.motion(task.robot_start, _commands(1, 50, 0.3, 2))
    noise = np.random.default_rng(3).standard_normal((50, 1)) * model.noise_std
    states = motion[0, :, :2]
    measured = model.contact(np.zeros((50, 0)), motion[0, 1:], theta) + noise
    problem = make_problem(model, TangentEvaluator(model), [Data(states, measured)])
    start = model.parameters.mean
    cost, gradient = problem.cost_and_gradient(start)
    hessian = problem.fisher(start).sum(axis=0) + problem.prior.information
    steepest = cost - problem.cost(start - np.linalg.solve(hessian, gradient))
    length = float(gradient @ gradient / (gradient @ hessian @ gradient))
    plain = cost - problem.cost(start - length * gradient)
    found = cost - _lowest(problem, start)
    return _claim(
        "δθ = F⁻¹∇L is the steepest step",
        f"pinching, 30 % off: it gains {100 * steepest / found:.0f} % of what there is to gain, "
        f"the gradient alone {100 * plain / found:.0f} %",
        bool(steepest > plain and steepest > 0.9 * found),
    )


def _lowest(problem: MapProblem, theta: Array) -> float:
    """The cost after ten Gauss–Newton steps."""
    for _ in range(10):
        _, gradient = problem.cost_and_gradient(theta)
        hessian = problem.fisher(theta).sum(axis=0) + problem.prior.information
        theta = problem.model.parameters.clip(theta - np.linalg.solve(hessian, gradient))
    return problem.cost(theta)


def _condition_bound() -> Claim:
    """(κ + 1/κ)² ≤ (‖F‖²‖F⁻¹‖² − (n − 2))² holds, but is independent of the trace: F and 10 F have the same bound."""
    random = np.random.default_rng(4)
    broken, moved = 0, 0.0
    for _ in range(1000):
        root = random.standard_normal((2, 2))
        fisher = root @ root.T + 1e-3 * np.eye(2)
        bound = _bound(fisher)
        kappa = float(np.linalg.cond(fisher))
        broken += (kappa + 1.0 / kappa) ** 2 > bound**2 * (1.0 + 1e-6)
        moved = max(moved, abs(_bound(10.0 * fisher) / bound - 1.0))
    return Claim(
        "Maximising the trace moves the bound on the condition number",
        f"the bound fails {broken} times in 1000; ten times the trace changes it by {100 * moved:.2g} %",
        "does not hold" if moved < 1e-6 else "holds",
    )


def _bound(fisher: Array) -> float:
    return float((fisher**2).sum() * (np.linalg.inv(fisher) ** 2).sum())


def _saltation() -> Claim:
    """Sensitivities through lost and regained contact without jump terms, against finite differences of rollouts."""
    model, theta = CompliantHefting(), np.array([TRUE_MASS])
    differences, ratios = [], []
    evaluators: tuple[Evaluator, ...] = (
        TangentEvaluator(model),
        FiniteDifferenceEvaluator(model, 1e-7),
        FiniteDifferenceEvaluator(model, 1e-2),
    )
    for seed in range(12):
        motion = model.motion(np.array([0.2, 0.0]), _commands(1, 40, 1.0, seed))
        start = model.start(motion[0, 0], theta)
        tangent, near, far = (evaluate(motion, theta, start) for evaluate in evaluators)
        if (tangent.forces == 0).any():
            largest = np.abs(near.sensitivities).max()
            differences.append(float(np.abs(tangent.sensitivities - near.sensitivities).max() / largest))
            ratios.append(float((tangent.sensitivities**2).sum() / (far.sensitivities**2).sum()))
    said = (
        f"{len(differences)} throws of the ball: derivatives right to {max(differences):.1e}; but over ±1 % of the "
        f"mass, touches come earlier or later, and the information by derivatives is {min(ratios):.2g} to "
        f"{max(ratios):.2g} times that by differences"
    )
    return _claim("No saltation matrices are needed, belief being continuous", said, max(differences) < 1e-3)


def _codependent() -> list[Claim]:
    """Rank of the information of friction and stiffness together, with and without the normal force."""
    ranks = {}
    for measures_normal in (False, True):
        model = Rubbing(measures_normal=measures_normal)
        both = model.parameters.of([*model.parameters.free, _stiffness(model)])
        model = Rubbing(measures_normal=measures_normal, parameters=both, damping=0.0)
        random = np.random.default_rng(5)
        motion = np.stack([random.uniform(0.03, 0.04, 40), np.full(40, 0.7), *random.uniform(0.5, 1.0, (2, 40))], -1)
        theta = np.array([TRUE_FRICTION, 100.0])
        ranks[measures_normal] = int(np.linalg.matrix_rank(_of_samples(model, motion, theta), rtol=1e-9))
    alone, together = ranks[False], ranks[True]
    return [
        _claim(
            "Co-dependent parameters are unidentifiable together",
            f"friction and stiffness from the tangential force: rank {alone} of 2, μK alone is known",
            alone == 1,
        ),
        _claim(
            "unless more is assumed or measured of the contact",
            f"with the normal force measured: rank {together} of 2",
            together == 2,
        ),
    ]


def _stiffness(model: Rubbing) -> Parameter:
    return Parameter("stiffness", model.stiffness, std=30.0, lower=1.0, unit="N/m")


def _of_samples(model: PlanningModel, motion: Array, theta: Array) -> Array:
    force = model.contact_jacobians(np.zeros((len(motion), 0)), motion, theta)
    rows = model.measurement_jacobians(np.zeros((len(motion), 0)), motion, force.value, theta).wrt_force
    return np.asarray(fisher_information((rows @ force.wrt_parameters)[np.newaxis], model.noise_std)[0])


def _claim(claim: str, found: str, holds: bool) -> Claim:
    return Claim(claim, found, "holds" if holds else "does not hold")
