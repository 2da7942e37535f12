"""CA-MAP as in the paper's Def. 4: one program over θ and the trajectory τ, with the contact law as constraints.

    min over θ, x, λ of  ½ Σ |(y − g(x, λ, θ)) / σ|² + ½ |θ − θ₀|²_{Σ₀⁻¹}
    subject to           x_0 = x_0(θ),   λ_k = contact(x_k, r_k, θ),   x_{k+1} = step(x_k, r_k, r_{k+1}, λ_k, θ)

Without a measured pose it has wrong local optima, and a law with kinks is not differentiable at touch-down: use a model
with a smooth law, and start from the shooting solution.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver

from drake_cafim.errors import InputError
from drake_cafim.estimation.problem import MapProblem
from drake_cafim.estimation.shooting import MapEstimate, SolverReport, on_bound
from drake_cafim.sensitivity.model import Jacobians
from drake_cafim.typing import Array

MET = 1e-5
"""N and m, the largest violation of the constraints at which a joint solution counts as one."""
RAISED = 1e-3
"""By how much a joint solution may be worse than the shooting solution in ℓ: solvers end within their tolerances."""


@dataclass(frozen=True)
class JointProgram:
    """The program and its variables: z (n,) is (θ − θ₀)/s with s the prior std; states and forces by experiment.

    `states` are (K, nx) and `forces` (K, nλ) over the integration steps of each experiment.
    """

    program: MathematicalProgram
    z: Any
    states: tuple[Any, ...]
    forces: tuple[Any, ...]
    centre: Array
    scale: Array


@dataclass(frozen=True)
class JointEstimate:
    """The solution: θ (n,) and the forces (K, nλ) at each experiment's integration steps.

    `solved` is the solver's status; `violation` the largest constraint violation (of constraints in N and m), to be
    checked even where `solved` is true.
    """

    theta: Array
    forces: tuple[Array, ...]
    cost: float
    solved: bool
    status: int
    violation: float
    message: str


def build_joint_program(problem: MapProblem) -> JointProgram:
    """The program of all experiments of `problem`, with constraints for the contact law and the step at each knot."""
    model = problem.model
    parameters = model.parameters
    centre, scale = problem.prior.mean, problem.prior.std
    scale = np.where(np.isfinite(scale), scale, np.maximum(np.abs(centre), 1.0))
    program = MathematicalProgram()
    z = program.NewContinuousVariables(len(centre), "z")
    lower, upper = parameters.bounds
    least: Any = (lower - centre) / scale
    greatest: Any = (upper - centre) / scale
    program.AddBoundingBoxConstraint(least, greatest, z)
    information: Any = problem.prior.information * np.outer(scale, scale)
    none: Any = np.zeros(len(centre))
    program.AddQuadraticCost(information, none, z)
    joint = JointProgram(program, z, (), (), centre, scale)
    states, forces = [], []
    for group in problem.groups:
        for motion, measured in zip(group.motion, group.measurements, strict=True):
            x, force = _add_experiment(joint, problem, motion, measured)
            states.append(x)
            forces.append(force)
    return JointProgram(program, z, tuple(states), tuple(forces), centre, scale)


def _add_experiment(joint: JointProgram, problem: MapProblem, motion: Array, measured: Array) -> tuple[Any, Any]:
    """Add an experiment's variables, constraints and costs to the program; its state and force variables."""
    model, program, z = problem.model, joint.program, joint.z
    knots = len(motion)
    nx = model.state_size
    nf = len(model.contact(np.zeros(nx), motion[0], joint.centre))
    x = program.NewContinuousVariables(knots, max(nx, 1), "x")[:, :nx]
    force = program.NewContinuousVariables(knots, nf, "f")

    def theta_of(values: Array) -> Array:
        return np.asarray(joint.centre + joint.scale * values)

    def start(values: Array) -> tuple[Array, Array]:
        given = model.start(motion[0], theta_of(values[nx:]))
        return values[:nx] - given.state, np.hstack([np.eye(nx), -given.sensitivity * joint.scale])

    if nx:
        _constrain(program, start, np.concatenate([x[0], z]), nx)
    for k in range(knots):
        _constrain(program, _contact(problem, theta_of, joint.scale, motion[k], nf), [*force[k], *x[k], *z], nf)
        if nx and k + 1 < knots:
            step = _step(problem, theta_of, joint.scale, motion[k], motion[k + 1], nf)
            _constrain(program, step, [*x[k + 1], *x[k], *force[k], *z], nx)
        if k > 0 and k % model.substeps == 0:
            reading = measured[k // model.substeps - 1]
            cost = _residual(problem, theta_of, joint.scale, motion[k], nf, reading)
            _add_cost(program, cost, [*force[k], *x[k], *z])
    return x, force


Function = Callable[[Array], tuple[Array, Array]]
"""From values (m,) to a value (k,) and its Jacobian (k, m)."""


def _contact(problem: MapProblem, theta_of: Any, scale: Array, motion: Array, nf: int) -> Function:
    """The constraint λ − contact(x, r, θ) = 0 as a function of (λ, x, z), with its Jacobian."""
    model, nx = problem.model, problem.model.state_size

    def function(values: Array) -> tuple[Array, Array]:
        law = model.contact_jacobians(values[nf : nf + nx], motion, theta_of(values[nf + nx :]))
        by_x, by_theta = _pieces(law, nf, nx, len(scale))[::2]
        return values[:nf] - law.value, np.hstack([np.eye(nf), -by_x, -by_theta * scale])

    return function


def _step(problem: MapProblem, theta_of: Any, scale: Array, motion: Array, following: Array, nf: int) -> Function:
    """The constraint x_{k+1} − step(x_k, r_k, r_{k+1}, λ_k, θ) = 0 of (x_{k+1}, x_k, λ_k, z), with its Jacobian."""
    model, nx = problem.model, problem.model.state_size

    def function(values: Array) -> tuple[Array, Array]:
        x, force = values[nx : 2 * nx], values[2 * nx : 2 * nx + nf]
        step = model.step_jacobians(x, motion, following, force, theta_of(values[2 * nx + nf :]))
        by_x, by_force, by_theta = _pieces(step, nf, nx, len(scale))
        return values[:nx] - step.value, np.hstack([np.eye(nx), -by_x, -by_force, -by_theta * scale])

    return function


def _residual(problem: MapProblem, theta_of: Any, scale: Array, motion: Array, nf: int, reading: Array) -> Function:
    """The cost ½ |(y − g)/σ|² of one sample as a function of (λ, x, z), with its gradient; NaNs in y are skipped."""
    model, nx = problem.model, problem.model.state_size
    seen = np.isfinite(reading)

    def function(values: Array) -> tuple[Array, Array]:
        force, x = values[:nf], values[nf : nf + nx]
        sensor = model.measurement_jacobians(x, motion, force, theta_of(values[nf + nx :]))
        by_x, by_force, by_theta = _pieces(sensor, nf, nx, len(scale))
        residual = np.where(seen, (np.where(seen, reading, 0.0) - sensor.value) / model.noise_std, 0.0)
        slope = np.hstack([by_force, by_x, by_theta * scale]) / model.noise_std[:, np.newaxis]
        return np.array([0.5 * residual @ residual]), -(residual @ slope)[np.newaxis]

    return function


def _pieces(jacobians: Jacobians, nf: int, nx: int, n: int) -> tuple[Array, Array, Array]:
    """The three derivative blocks broadcast to their full shapes (k, nx), (k, nf), (k, n)."""
    k = len(jacobians.value)
    blocks = (jacobians.wrt_state, jacobians.wrt_force, jacobians.wrt_parameters)
    x, force, theta = (np.broadcast_to(block, (k, size)) for block, size in zip(blocks, (nx, nf, n), strict=True))
    return x, force, theta


def _evaluate(function: Function, values: Any) -> Any:
    """The value of `function` for float arguments, or with derivatives by the chain rule for AutoDiffXd arguments."""
    if values.dtype != object:
        return function(values)[0]
    plain = np.array([value.value() for value in values])
    derivatives = np.array([value.derivatives() for value in values])
    value, jacobian = function(plain)
    return np.array([AutoDiffXd(v, row) for v, row in zip(value, jacobian @ derivatives, strict=True)])


def _constrain(program: MathematicalProgram, function: Function, variables: Any, size: int) -> None:
    zero: Any = np.zeros(size)
    program.AddConstraint(lambda values: _evaluate(function, values), zero, zero, vars=np.asarray(variables))


def _add_cost(program: MathematicalProgram, function: Function, variables: Any) -> None:
    program.AddCost(lambda values: _evaluate(function, values)[0], vars=np.asarray(variables))


def solve_joint(problem: MapProblem, theta: Array, solver: str = "snopt") -> JointEstimate:
    """Solve the joint program of `problem`, started from the trajectory that θ (n,) predicts.

    `solver` is `snopt` or `ipopt`, else `InputError`. The result contains the solver's status and constraint violation.
    """
    solvers = {"snopt": SnoptSolver, "ipopt": IpoptSolver}
    if solver not in solvers:
        raise InputError(f"solver {solver!r}: expected one of {', '.join(solvers)}")
    joint = build_joint_program(problem)
    guess: Any = _guess(joint, problem, theta)
    result = solvers[solver]().Solve(joint.program, guess)
    z = result.GetSolution(joint.z)
    solution = result.get_x_val()
    evaluate: Any = joint.program.EvalBinding
    constraints = joint.program.generic_constraints()
    violation = max(float(np.abs(evaluate(constraint, solution)).max()) for constraint in constraints)
    status = result.get_solution_result().name
    return JointEstimate(
        theta=np.asarray(joint.centre + joint.scale * z),
        forces=tuple(result.GetSolution(force) for force in joint.forces),
        cost=float(result.get_optimal_cost()),
        solved=bool(result.is_success()),
        status=int(result.get_solution_result().value),
        violation=violation,
        message=f"{solver} ended with {status}, constraints met to {violation:.1e}",
    )


def _guess(joint: JointProgram, problem: MapProblem, theta: Array) -> Array:
    """Values of all variables for the trajectory that the model predicts at θ (n,), which meets all constraints."""
    model, program = problem.model, joint.program
    guess: Any = np.zeros(program.num_vars())
    z: Any = (theta - joint.centre) / joint.scale
    program.SetDecisionVariableValueInVector(joint.z, z, guess)
    motions = [motion for group in problem.groups for motion in group.motion]
    for motion, x, force in zip(motions, joint.states, joint.forces, strict=True):
        state = model.start(motion[0], theta).state
        for k in range(len(motion)):
            value: Any = model.contact(state, motion[k], theta)
            program.SetDecisionVariableValueInVector(force[k], value, guess)
            if model.state_size:
                program.SetDecisionVariableValueInVector(x[k], state, guess)
            if k + 1 < len(motion):
                state = model.step(state, motion[k], motion[k + 1], value, theta)
    return np.asarray(guess)


def refine_jointly(problem: MapProblem, found: MapEstimate) -> MapEstimate:
    """The estimate by the joint program, started from the shooting estimate `found`.

    The joint solution is taken where the solver succeeded, met the constraints to `MET` and did not raise ℓ(θ), which
    a program with kinks may; else `found` stands, and `solver` says that the joint program failed.
    """
    joint = solve_joint(problem, found.belief.mean)
    theta = problem.model.parameters.clip(joint.theta)
    held = joint.solved and joint.violation <= MET and problem.cost(theta) <= found.cost + RAISED
    report = SolverReport(held, joint.status, joint=True)
    if not held:
        return replace(found, solver=report)
    fisher = problem.fisher(theta)
    return MapEstimate(
        problem.prior.update(fisher.sum(axis=0), theta),
        fisher,
        problem.cost(theta),
        report,
        on_bound(problem, theta),
    )
