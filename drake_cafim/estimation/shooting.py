"""CA-MAP by shooting: a MathematicalProgram over θ alone, started from a coarse grid.

Where a guess predicts no contact the likelihood is flat, and no local solver leaves it: hence the grid.
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
    """Of the search; the defaults are those of every packaged scenario."""

    grid_points: int = 11  # a dimension, over ± grid_width prior std
    grid_width: float = 3.0
    grid_limit: int = 2000  # points in all; more dimensions get fewer each
    starts: int = 3  # best grid points that are polished
    gauss_newton_steps: int = 2  # before the program starts
    tolerance: float = 1e-8  # SNOPT's optimality, in prior std


@dataclass(frozen=True)
class SolverReport:
    """What the solver said: Drake's `SolutionResult` by its number, which a Context can hold."""

    solved: bool
    status: int

    @property
    def message(self) -> str:
        """In a sentence, with what to try where it found no optimum."""
        if self.solved:
            return "SNOPT found an optimum"
        name = SolutionResult(self.status).name
        return f"SNOPT stopped with {name}: compare its cost with the grid's, or give a better prior or more data"


@dataclass(frozen=True)
class MapEstimate:
    """The belief after the data; `fisher` (E, n, n) is each experiment's alone, at the estimate.

    `solved` tells whether the solver said so; `message` says what it said, and what to try if it did not.
    """

    belief: Belief
    fisher: Array
    cost: float
    solver: SolverReport
    on_bound: tuple[str, ...]

    @property
    def solved(self) -> bool:
        return self.solver.solved

    @property
    def message(self) -> str:
        return self.solver.message


def build_program(problem: MapProblem) -> tuple[MathematicalProgram, Any, Callable[[Array], Array]]:
    """The program, its variables z (n,), and the map from z to θ = θ₀ + s·z with s the prior std.

    A user may add costs and constraints on z before solving.
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
    """The MAP estimate of `problem`: the best of the program's solutions from several starts."""
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
        on_bound=_on_bound(problem, theta),
    )


def _starts(problem: MapProblem, config: ShootingConfig) -> list[Array]:
    """The best points of a grid over the prior, the prior's mean among them."""
    parameters = problem.model.parameters
    lower, upper = parameters.bounds
    count = max(3, min(config.grid_points, int(config.grid_limit ** (1.0 / len(parameters.free)))))
    axes = []
    for mean, std, low, high in zip(problem.prior.mean, problem.prior.std, lower, upper, strict=True):
        reach = config.grid_width * std if np.isfinite(std) else max(abs(mean), 1.0)
        axes.append(np.linspace(max(low, mean - reach), min(high, mean + reach), count))
    points = [problem.prior.mean, *(np.array(point) for point in product(*axes))]
    costs = np.array([problem.cost(point) for point in points])
    return [points[index] for index in np.argsort(costs, kind="stable")[: config.starts]]


def _gauss_newton(problem: MapProblem, theta: Array, steps: int) -> Array:
    """A few Gauss–Newton steps, each kept only if it lowers the cost."""
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


def _on_bound(problem: MapProblem, theta: Array) -> tuple[str, ...]:
    lower, upper = problem.model.parameters.bounds
    return tuple(
        name
        for name, value, low, high in zip(problem.prior.names, theta, lower, upper, strict=True)
        if value <= low or value >= high
    )
