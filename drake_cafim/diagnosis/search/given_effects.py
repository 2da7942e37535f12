"""Fits a given explanation to recordings, without a search: unknowns, strengths and shapes of its effects."""

from drake_cafim.diagnosis.fit.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.state import ROUNDS, has_moved


def fit_given(problem: SearchProblem, start: Model) -> tuple[SearchProblem, Fit]:
    """The fit of `start`, an explanation whose effects have values, and the problem whitened under the fitted model.

    The covariance of the noise depends on the unknowns and on the effects, so that whitening and fitting alternate
    until the unknowns settle.
    """
    fitted = _fit(problem, start)
    for _ in range(ROUNDS if len(start.vector) else 0):
        before, problem = fitted.model, problem.rewhitened(fitted.model)
        fitted = _fit(problem, before)
        if not has_moved(problem, before, fitted.model):
            break
    return problem, fitted


def _fit(problem: SearchProblem, start: Model) -> Fit:
    if not start.effects:
        return unbiased_fit(problem, start)
    return unbiased_fit(problem, fit_shapes(problem, fit(problem, start)).model)
