"""Maximum a posteriori fits of a model's numbers to whitened rows."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Fit:
    """A fitted model: `residual` whitened rows and prior rows, `jacobian` of them, `covariance` of the numbers."""

    model: Model
    residual: Array
    jacobian: Array
    data_rows: int

    @property
    def chi_square(self) -> float:
        """Σ of squared whitened rows, priors included."""
        return float(self.residual @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Data rows less the strengths; an unknown and its prior row cancel."""
        return self.data_rows - (len(self.model.vector) - len(self.model.unknown))

    @property
    def covariance(self) -> Array:
        """(n + k, n + k) of unknowns and strengths, under the stated noise."""
        normal = self.jacobian.T @ self.jacobian
        return np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=float)

    @property
    def std(self) -> Array:
        return np.asarray(np.sqrt(np.clip(np.diag(self.covariance), 0.0, None)), dtype=float)


def fit(problem: Problem, model: Model, iterations: int = 12) -> Fit:
    """The model's numbers at the nearest minimum of χ², by damped Gauss–Newton (Levenberg, Marquardt)."""
    residual = problem.residual(model)
    jacobian = problem.jacobian(model)
    damping = 1e-6
    for _ in range(iterations):
        if jacobian.shape[1] == 0:
            break
        trial, trial_residual, damping = _step(problem, model, residual, jacobian, damping)
        if trial is None:
            break
        gained = residual @ residual - trial_residual @ trial_residual
        model, residual = trial, trial_residual
        jacobian = problem.jacobian(model)
        if gained < 1e-3 + 1e-5 * (residual @ residual) / len(residual):
            break
    return Fit(model, residual, jacobian, problem.rows)


def _step(
    problem: Problem, model: Model, residual: Array, jacobian: Array, damping: float
) -> tuple[Model | None, Array, float]:
    """A model with smaller χ², or None where no damping finds one."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = jacobian / scale
    normal, gradient = scaled.T @ scaled, scaled.T @ residual
    for _ in range(8):
        step = -np.linalg.solve(normal + damping * np.eye(len(scale)), gradient) / scale
        trial = model.at(model.vector + step)
        trial_residual = problem.residual(trial)
        if np.all(np.isfinite(trial_residual)) and trial_residual @ trial_residual < residual @ residual:
            return trial, trial_residual, max(damping * 0.1, 1e-9)
        damping = max(damping * 10.0, 1e-6)
    return None, residual, damping
