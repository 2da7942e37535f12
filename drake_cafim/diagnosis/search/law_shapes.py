"""Fits the shape parameters of a law, which are not strengths: as the width over which friction changes sign."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import SHAPE_CHI_SQUARE_RANGE
from drake_cafim.effects.effect import Effect

FINER = (1.5, 1.15, 1.04)
"""Factors by which a shape parameter is then multiplied and divided, as long as χ² falls."""


def fit_shapes(
    problem: SearchProblem,
    best: Fit,
    of: Iterable[Key] | None = None,
    tolerance: float = 0.0,
    own_noise: bool = True,
) -> Fit:
    """The fit with the best shape of each effect in turn: first from the effect's grid, then between its values.

    Of the effects `of` these keys only, if they are given. A change of χ² by `tolerance` does not matter;
    `own_noise` is as for `fit`.

    With a wrong width, a change of sign looks like a law that falls or rises near rest.
    """
    keys = best.model.keys if of is None else frozenset(of)
    for position, present in enumerate(best.model.effects):
        if present.key not in keys:
            continue
        first, before, worst = best.chi_square, np.inf, -np.inf
        while before - best.chi_square > SHAPE_CHI_SQUARE_RANGE:
            before, effect = best.chi_square, best.model.effects[position]
            best, worst = _best_shape(problem, best, position, effect.restarts(), tolerance, own_noise)
            if not effect.shapes_about_values:
                # the grid does not depend on the values: it would be the same again
                break
        # χ² hardly depends on the shape: values between those of the grid cannot matter
        if max(first, worst) - best.chi_square < SHAPE_CHI_SQUARE_RANGE:
            continue
        for ratio in FINER:
            before = np.inf
            while best.chi_square < before - tolerance:
                before = best.chi_square
                finer = best.model.effects[position].between_shapes(ratio)
                best, _ = _best_shape(problem, best, position, finer, tolerance, own_noise)
    return best


def _best_shape(
    problem: SearchProblem, best: Fit, position: int, others: Iterable[Effect], tolerance: float, own_noise: bool
) -> tuple[Fit, float]:
    """The best of the given fit and those with each of `others` at `position`, and the largest χ² of these.

    Where the rows are nearly linear in the strengths, χ² to first order selects the shape that is fitted.
    """
    base, worst = best.model, -np.inf
    trials = [replace(base, effects=(*base.effects[:position], it, *base.effects[position + 1 :])) for it in others]
    expected = [chi for trial in trials if (chi := _expected(problem, best, trial, position, own_noise)) is not None]
    if expected:
        worst = max(expected)
        trials = [trials[int(np.argmin(expected))]] if min(expected) < best.chi_square else []
    for model in trials:
        trial = fit(problem, model, tolerance=tolerance, own_noise=own_noise)
        worst = max(worst, trial.chi_square)
        if trial.chi_square < best.chi_square:
            best = trial
    return best, worst


def _expected(problem: SearchProblem, best: Fit, model: Model, position: int, own_noise: bool) -> float | None:
    """χ² to first order of a fit started from `model`, whose effect at `position` has another shape than in `best`.

    min over bounded d of |z + J d|², by bounded least squares. None where the rows are not linear enough in the effect.
    """
    effects, columns = model.effects, problem.shape_columns(model, position)
    if columns is None:
        return None
    first = len(model.unknown) + sum(len(effect.strengths) for effect in effects[:position])
    residual, J = problem.residual(model), best.jacobian.copy()
    J[:, first : first + len(effects[position].strengths)] = columns
    basis, triangle = np.linalg.qr(J)
    along = basis.T @ residual
    lower, upper = (
        np.array([side] * len(model.unknown) + [getattr(s, bound) for effect in effects for s in effect.strengths])
        for side, bound in ((-np.inf, "lower"), (np.inf, "upper"))
    )
    left = lsq_linear(triangle, -along, (lower - model.vector, upper - model.vector), method="bvls").cost
    # what lags and unknown starts pay is theirs, and hardly changes with the shape of another law
    paid = best.penalty
    if effects[position].late:
        paid = problem.penalty(model, own_noise)
    return float(residual @ residual - along @ along + 2.0 * left) + paid
