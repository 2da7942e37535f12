"""The shape of a law that no strength gives, such as the width over which friction turns its sign."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import SHAPE_CHI_SQUARE_RANGE
from drake_cafim.effects.effect import Effect

FINER = (1.5, 1.15, 1.04)
"""Ratios in which a shape is then changed, as long as it helps."""


def fit_shapes(problem: SearchProblem, one: Fit) -> Fit:
    """The fit with the best shape of each effect, one after the other: from the grid, then between its values.

    A width that is off makes a sign change look like a law that falls or rises near rest.
    """
    for position in range(len(one.model.effects)):
        first, before = one.chi_square, np.inf
        while before - one.chi_square > SHAPE_CHI_SQUARE_RANGE:
            before, effect = one.chi_square, one.model.effects[position]
            one, worst = _best_shape(problem, one, position, effect.restarts())
            if not effect.shapes_about_values:
                # what is tried are values of a grid, the same ones again
                break
        if max(first, worst) - one.chi_square < SHAPE_CHI_SQUARE_RANGE:
            continue
        for ratio in FINER:
            before = np.inf
            while one.chi_square < before:
                before = one.chi_square
                one, _ = _best_shape(problem, one, position, one.model.effects[position].between_shapes(ratio))
    return one


def _best_shape(problem: SearchProblem, one: Fit, position: int, others: Iterable[Effect]) -> tuple[Fit, float]:
    """The best of the fit and those with each of `others` in the effect's place, and the largest χ² of these.

    Where the rows are all but linear in the strengths, one look tells which of the shapes is worth a fit.
    """
    base, worst = one.model, -np.inf
    trials = [replace(base, effects=(*base.effects[:position], it, *base.effects[position + 1 :])) for it in others]
    expected = [chi for trial in trials if (chi := _expected(problem, one, trial, position)) is not None]
    if expected:
        worst = max(expected)
        trials = [trials[int(np.argmin(expected))]] if min(expected) < one.chi_square else []
    for model in trials:
        trial = fit(problem, model)
        worst = max(worst, trial.chi_square)
        if trial.chi_square < one.chi_square:
            one = trial
    return one, worst


def _expected(problem: SearchProblem, one: Fit, model: Model, position: int) -> float | None:
    """χ² of a fit that begins at `model`, to first order; it has another shape than the fitted one at `position`.

    None where the rows are too far from linear in the effect for that.
    """
    effects, columns = model.effects, problem.shape_columns(model, position)
    if columns is None:
        return None
    first = len(model.unknown) + sum(len(effect.strengths) for effect in effects[:position])
    residual, J = problem.residual(model), one.jacobian.copy()
    J[:, first : first + len(effects[position].strengths)] = columns
    basis, triangle = np.linalg.qr(J)
    along = basis.T @ residual
    lower, upper = (
        np.array([side] * len(model.unknown) + [getattr(s, bound) for effect in effects for s in effect.strengths])
        for side, bound in ((-np.inf, "lower"), (np.inf, "upper"))
    )
    left = lsq_linear(triangle, -along, (lower - model.vector, upper - model.vector), method="bvls").cost
    return float(residual @ residual - along @ along + 2.0 * left) + problem.penalty(model)
