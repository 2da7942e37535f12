"""Score tests: the first-order decrease of χ² by each effect, with the fitted parameters projected out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.columns import Columns, Nuisance, change_by, products_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.effects.effect import Effect
from drake_cafim.parallel.forked import map_forked
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Candidate:
    """An effect with values to start an exact fit from, and its `gain`, the decrease of χ² to first order."""

    effect: Effect
    gain: float
    strengths: int
    trials: int
    """How many looks (shapes, places, times) were tried to find this one."""
    gains: Array = field(default_factory=lambda: np.zeros(0), repr=False, compare=False)
    """(r,) decrease of χ² in each row of a window, to first order."""


DIVERGED = 1e100
"""Norm of a column beyond which a simulated state has diverged."""
LEAST_INFORMATION = 1e-9
"""Information on a combination of columns, over the largest one, below which the columns count as collinear."""


def screen(
    problem: SearchProblem, at: Fit, effects: Sequence[Effect], rest: Fit | None = None, jobs: int = 1
) -> list[Candidate]:
    """The candidates among `effects` beyond the fitted model `at`, largest gain first, by `jobs` processes.

    With a `rest` of `at`, they take the place of what that lacks: they act along the motion of `at`, and are weighed
    against the residual and the slopes of `rest`.
    """
    nuisance = Nuisance.of(rest or at)
    looks = map_forked(lambda number: _best_look(problem, at, effects[number], nuisance), len(effects), jobs)
    return sorted((look for look in looks if look is not None), key=lambda candidate: -candidate.gain)


def _best_look(problem: SearchProblem, at: Fit, effect: Effect, nuisance: Nuisance) -> Candidate | None:
    best: tuple[Candidate, Array | Columns, Array] | None = None
    looks = problem.looks(at, effect)
    trials = looks.tried
    for columns, build in looks.found:
        trials += 1
        solved = solve_beside(columns, nuisance)
        if solved is None:
            continue
        coefficients, gain = solved
        if best is not None and gain <= best[0].gain:
            continue
        built = build(coefficients)
        # a friction that drives, or a negative inertia, is no explanation, however well it fits
        if built is not None and built.plausible():
            best = Candidate(built, gain, len(effect.strengths), 0), columns, coefficients
    if best is None:
        return None
    candidate, columns, coefficients = best
    change = change_by(columns, coefficients)
    basis, residual = nuisance.basis[: len(change)], nuisance.residual
    adapted = change - basis @ (basis.T @ change)
    return replace(
        candidate, trials=trials, gains=by_row(problem, residual) - by_row(problem, residual[: len(change)] + adapted)
    )


def by_row(problem: Problem, residual: Array) -> Array:
    """(r,) χ² in each row of a window."""
    return np.asarray(np.sum([np.sum(z**2, axis=0) for _, z in by_run(problem, residual[: problem.rows])], axis=0))


def solve_beside(columns: Array | Columns, nuisance: Nuisance) -> tuple[Array, float] | None:
    """Coefficients (c,) of `columns` X (R, c) by least squares beside the nuisance, and the decrease of χ².

    With P = I − QQᵀ for the nuisance's orthonormal basis Q, and its residual z = P z, c = −(XᵀPX)⁻¹ Xᵀz and the
    decrease is zᵀX (XᵀPX)⁻¹ Xᵀz. None where the nuisance spans the columns.
    """
    together, along, score = products_of(columns, nuisance)
    with np.errstate(invalid="ignore"):
        full = np.sqrt(np.diag(together))
    if not np.all(full < DIVERGED):
        return None
    size = np.maximum(full, 1e-300)
    along = along / size
    gram = together / size / size[:, None] - along.T @ along
    left = np.sqrt(np.clip(np.diag(gram), 0.0, None))
    # a column that the nuisance spans, or that is zero but for rounding, carries no information
    seen = (left > 1e-4) & (full > 1e-8 * np.max(full)) & (full > 0.0)
    if not np.any(seen):
        return None
    scale = left[seen]
    known, axes = np.linalg.eigh(gram[np.ix_(seen, seen)] / np.outer(scale, scale))
    score = (score / size)[seen] / scale
    distinct = known > LEAST_INFORMATION * known[-1]
    solution = -axes[:, distinct] @ (axes[:, distinct].T @ score / known[distinct])
    coefficients = np.zeros(len(full))
    coefficients[seen] = solution / scale / full[seen]
    return coefficients, float(-score @ solution)
