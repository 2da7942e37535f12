"""Fits one effect while the slopes of all other parameters are kept: what one law explains hardly bends the others."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.bounds import clip_unknowns, solve_within
from drake_cafim.diagnosis.fit.fitting import Fit, allowed_steps
from drake_cafim.diagnosis.fit.model import Model, step_from
from drake_cafim.diagnosis.fit.posterior import posterior
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.typing import Array

MOST_STEPS, MOST_HALVINGS = 4, 2
"""Largest number of Gauss-Newton steps, and how often one that does not lower χ² is halved."""


@dataclass(frozen=True)
class Beside:
    """The slopes J (R + n, m) of all parameters but those of the effect at a `position`, J = Q R, and their values.

    Small changes of them are followed by their slopes: computed again, the motion under a delay takes most of the time
    of a fit. So the rows are as exact as they are linear in all but the effect.
    """

    problem: SearchProblem
    position: int
    around: Array
    """(m,) values of these parameters, at which the rows are computed."""
    slopes: Array
    basis: Array
    triangle: Array

    @classmethod
    def of(cls, problem: SearchProblem, found: Fit, position: int) -> "Beside":
        """Beside the parameters of a fit without those of its effect at `position`."""
        own = strengths_at(found.model, position)
        slopes = np.delete(found.jacobian, own, axis=1)
        basis, triangle = np.linalg.qr(slopes)
        return cls(problem, position, np.delete(found.model.vector, own), slopes, basis, triangle)

    def residual(self, model: Model) -> Array:
        """The whitened rows and prior rows (R + n,) of `model`, whose effect at `position` is any."""
        own = strengths_at(model, self.position)
        change = np.delete(model.vector, own) - self.around
        return self.problem.residual(self._near(model)) + self.slopes @ change

    def columns(self, model: Model) -> Array:
        """The slopes (R + n, k) of the strengths of its effect."""
        return self.problem.effect_columns(self._near(model), self.position)

    def fit(self, model: Model, tolerance: float) -> Fit:
        """The fit from `model`; it ends where a step would lower χ² by less than `tolerance`."""
        residual, columns = self.residual(model), self.columns(model)
        for _ in range(MOST_STEPS):
            step, left = self.step(model, residual, columns)
            if not float(residual @ residual) - left > tolerance:
                break
            lower = self._lower(model, residual, step)
            if lower is None:
                break
            model, residual = lower
            columns = self.columns(model)
        at = [strengths_at(model, self.position).start] * columns.shape[1]
        jacobian = np.insert(self.slopes, at, columns, axis=1)
        seen = jacobian[: self.problem.rows]
        covariance = posterior(self.problem, model, seen.T @ seen)
        paid = self.problem.penalty(self._near(model))
        return Fit(model, residual, jacobian, covariance, self.problem.rows, penalty=paid)

    def step(self, model: Model, residual: Array, columns: Array) -> tuple[Array, float]:
        """The Gauss-Newton step (n + k,) within the bounds from `model`, and χ² after it, to first order.

        min over bounded d of |z + J d|² for the `residual` z, with the effect's own `columns` (R + n, c) in J.
        """
        own, m = strengths_at(model, self.position), self.slopes.shape[1]
        along = self.basis.T @ columns
        across, corner = np.linalg.qr(columns - self.basis @ along)
        triangle = np.block([[self.triangle, along], [np.zeros((len(corner), m)), corner]])
        seen = np.concatenate([self.basis.T @ residual, across.T @ residual])
        order = np.r_[0 : own.start, own.stop : len(model.vector), own]
        lower, upper = (bound[order] for bound in allowed_steps(self.problem, model))
        step = np.zeros(len(order))
        step[order], cost = solve_within(triangle, seen, lower, upper)
        return step, float(residual @ residual - seen @ seen + 2.0 * cost)

    def _lower(self, model: Model, residual: Array, step: Array) -> tuple[Model, Array] | None:
        """The model after a `step`, halved until χ² is lower there, and its residual; None where it is not."""
        for _ in range(1 + MOST_HALVINGS):
            trial = clip_unknowns(self.problem, step_from(self.problem.scene, model, step))
            if all(effect.plausible() for effect in trial.effects):
                there = self.residual(trial)
                if float(there @ there) < float(residual @ residual):
                    return trial, there
            step = 0.5 * step
        return None

    def _near(self, model: Model) -> Model:
        """The model with the values `around` of all parameters but those of its effect."""
        own, vector = strengths_at(model, self.position), np.empty(len(model.vector))
        vector[own], vector[: own.start], vector[own.stop :] = (
            model.vector[own],
            self.around[: own.start],
            self.around[own.start :],
        )
        return model.at(vector)


def strengths_at(model: Model, position: int) -> slice:
    """Where the strengths of the effect at `position`, or of one behind the last, are among a model's parameters."""
    start = len(model.unknown) + sum(len(effect.strengths) for effect in model.effects[:position])
    return slice(start, start + sum(len(effect.strengths) for effect in model.effects[position : position + 1]))
