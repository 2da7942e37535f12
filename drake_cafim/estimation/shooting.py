"""CA-MAP by shooting: a MathematicalProgram over θ alone, started from the best points of a coarse grid.

Where a guess predicts no contact the likelihood is constant, and no local solver can leave it: hence the grid.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.solvers import (
    MathematicalProgram,
    MathematicalProgramResult,
    SnoptSolver,
    SolutionResult,
    SolverOptions,
)

from drake_cafim.belief import Belief
from drake_cafim.estimation.problem import MapProblem
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ShootingConfig:
    """Settings of the search; the defaults are those of all packaged scenarios."""

    grid_points: int = 11  # in each dimension
    grid_width: float = 3.0  # prior std, on both sides of the prior mean
    grid_limit: int = 2000  # points in all; with many dimensions there are fewer in each
    starts: int = 3  # number of the best grid points from which the program is solved
    gauss_newton_steps: int = 2  # before each solution of the program
    tolerance: float = 1e-8  # SNOPT's optimality tolerance, in prior std


@dataclass(frozen=True)
class SolverReport:
    """The solver's status: success, and Drake's `SolutionResult` as a number, which a Context can hold."""

    solved: bool
    status: int
    joint: bool = False  # of the program over parameters and forces together

    @property
    def message(self) -> str:
        """The status as a sentence, with what stands if there is no optimum."""
        if self.joint:
            name = SolutionResult(self.status).name
            if self.solved:
                return "SNOPT found an optimum of parameters and forces together"
            return f"SNOPT, of parameters and forces together, ended elsewhere ({name}): the shooting estimate stands"
        if self.solved:
            return "SNOPT found an optimum"
        name = SolutionResult(self.status).name
        return f"SNOPT ended before an optimum ({name}): the best point that it reached stands"


@dataclass(frozen=True)
class MapEstimate:
    """The belief after the data; `fisher` (E, n, n) is the information of each experiment at the estimate.

    `cost` is ℓ at the optimum; `on_bound` names the parameters whose estimate is at a bound.
    """

    belief: Belief
    fisher: Array
    cost: float
    solver: SolverReport
    on_bound: tuple[str, ...]

    @property
    def solved(self) -> bool:
        """Whether the solver reports an optimum."""
        return self.solver.solved

    @property
    def message(self) -> str:
        """The solver's status as a sentence."""
        return self.solver.message


def build_program(problem: MapProblem) -> tuple[MathematicalProgram, Any, Callable[[Array], Array]]:
    """The program, its variables z (n,), and the function from z to θ = θ₀ + s·z with s the prior std.

    Its cost is ℓ and its bounds are those of the parameters; you may add costs and constraints on z before solving.
    """
    parameters = problem.model.parameters
    lower, upper = parameters.bounds
    centre, scale = problem.prior.mean, problem.prior.std
    scale = np.where(np.isfinite(scale), scale, np.maximum(np.abs(centre), 1.0))
    program = MathematicalProgram()
    z = program.NewContinuousVariables(len(centre), "z")

    def to_theta(values: Array) -> Array:
        return np.asarray(centre + scale * values)

    def cost(values: Any) -> Any:
        if values.dtype != object:
            return problem.cost(to_theta(values))
        plain = np.array([value.value() for value in values])
        size, gradient = problem.cost_and_gradient(to_theta(plain))
        derivatives = sum(g * s * value.derivatives() for g, s, value in zip(gradient, scale, values, strict=True))
        return AutoDiffXd(size, derivatives)

    least: Any = (lower - centre) / scale
    greatest: Any = (upper - centre) / scale
    program.AddBoundingBoxConstraint(least, greatest, z)
    program.AddCost(cost, vars=z)
    return program, z, to_theta


def solve(problem: MapProblem, config: ShootingConfig | None = None) -> MapEstimate:
    """The MAP estimate of `problem`: the solution of least cost from several starts, with Σ = (F + Σ₀⁻¹)⁻¹."""
    config = ShootingConfig() if config is None else config
    program, z, to_theta = build_program(problem)
    origin = to_theta(np.zeros(len(z)))
    scale = to_theta(np.ones(len(z))) - origin
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major optimality tolerance", config.tolerance)
    best: MathematicalProgramResult | None = None
    for start in _starts(problem, config):
        guess: Any = (_gauss_newton(problem, start, config.gauss_newton_steps) - origin) / scale
        result = SnoptSolver().Solve(program, guess, options)
        if best is None or result.get_optimal_cost() < best.get_optimal_cost():
            best = result
    assert best is not None
    theta = problem.model.parameters.clip(to_theta(best.GetSolution(z)))
    fisher = problem.fisher(theta)
    return MapEstimate(
        belief=problem.prior.update(fisher.sum(axis=0), theta),
        fisher=fisher,
        cost=float(best.get_optimal_cost()),
        solver=SolverReport(bool(best.is_success()), int(best.get_solution_result().value)),
        on_bound=on_bound(problem, theta),
    )


def _starts(problem: MapProblem, config: ShootingConfig) -> list[Array]:
    """The points of least cost of a grid over the prior and of the prior's mean, best first."""
    parameters = problem.model.parameters
    lower, upper = parameters.bounds
    count = max(3, min(config.grid_points, int(config.grid_limit ** (1.0 / len(parameters.free)))))
    axes = []
    for mean, std, low, high in zip(problem.prior.mean, problem.prior.std, lower, upper, strict=True):
        reach = config.grid_width * std if np.isfinite(std) else max(abs(mean), 1.0)
        axes.append(np.linspace(max(low, mean - reach), min(high, mean + reach), count))
    points = [problem.prior.mean, *(np.array(point) for point in product(*axes))]
    costs = problem.costs(np.array(points))
    return [points[index] for index in np.argsort(costs, kind="stable")[: config.starts]]


def _gauss_newton(problem: MapProblem, theta: Array, steps: int) -> Array:
    """θ after up to `steps` Gauss–Newton steps θ − (F + Σ₀⁻¹)⁻¹ dℓ/dθ; it stops at one that does not lower the cost."""
    for _ in range(steps):
        cost, gradient = problem.cost_and_gradient(theta)
        hessian = problem.fisher(theta).sum(axis=0) + problem.prior.information
        if np.linalg.matrix_rank(hessian) < len(theta):
            return theta
        moved = problem.model.parameters.clip(theta - np.linalg.solve(hessian, gradient))
        if not problem.cost(moved) < cost:
            return theta
        theta = moved
    return theta


def on_bound(problem: MapProblem, theta: Array) -> tuple[str, ...]:
    """The names of the parameters that are at a bound."""
    lower, upper = problem.model.parameters.bounds
    return tuple(
        name
        for name, value, low, high in zip(problem.prior.names, theta, lower, upper, strict=True)
        if value <= low or value >= high
    )
