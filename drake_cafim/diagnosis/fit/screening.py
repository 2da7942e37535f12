"""Score tests: the first-order decrease of χ² by each effect, with the fitted parameters projected out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.effects.effect import Effect
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


def screen(problem: SearchProblem, at: Fit, effects: Sequence[Effect], rest: Fit | None = None) -> list[Candidate]:
    """The candidates among `effects` beyond the fitted model `at`, largest gain first.

    With a `rest` of `at`, they take the place of what that lacks: they act along the motion of `at`, and are weighed
    against the residual and the slopes of `rest`.
    """
    left = rest or at
    basis = np.linalg.qr(left.jacobian)[0] if left.jacobian.shape[1] else np.zeros((len(left.residual), 0))
    residual = left.residual - basis @ (basis.T @ left.residual)
    found = []
    for effect in effects:
        candidate = _best_look(problem, at, effect, basis, residual)
        if candidate is not None:
            found.append(candidate)
    return sorted(found, key=lambda candidate: -candidate.gain)


def _best_look(problem: SearchProblem, at: Fit, effect: Effect, basis: Array, residual: Array) -> Candidate | None:
    best: Candidate | None = None
    change = np.zeros(0)
    looks = problem.looks(at, effect)
    trials = looks.tried
    for columns, build in looks.found:
        trials += 1
        solved = solve_beside(columns, basis[: len(columns)], residual[: len(columns)])
        if solved is None:
            continue
        coefficients, gain = solved
        if best is not None and gain <= best.gain:
            continue
        built = build(coefficients)
        # a friction that drives, or a negative inertia, is no explanation, however well it fits
        if built is not None and built.plausible():
            best, change = Candidate(built, gain, len(effect.strengths), 0), columns @ coefficients
    if best is None:
        return None
    adapted = change - basis[: len(change)] @ (basis[: len(change)].T @ change)
    return replace(
        best, trials=trials, gains=by_row(problem, residual) - by_row(problem, residual[: len(change)] + adapted)
    )


def by_row(problem: SearchProblem, residual: Array) -> Array:
    """(r,) χ² in each row of a window."""
    return np.asarray(np.sum([np.sum(z**2, axis=0) for _, z in by_run(problem, residual[: problem.rows])], axis=0))


def solve_beside(columns: Array, basis: Array, residual: Array) -> tuple[Array, float] | None:
    """Coefficients (c,) of `columns` X (R, c) by least squares beside the nuisance, and the decrease of χ².

    With P = I − QQᵀ for the nuisance's orthonormal `basis` Q, and the `residual` z = P z, c = −(XᵀPX)⁻¹ Xᵀz and the
    decrease is zᵀX (XᵀPX)⁻¹ Xᵀz. None where the nuisance spans the columns.
    """
    # the square of a diverged state overflows
    with np.errstate(over="ignore", invalid="ignore"):
        together = columns.T @ columns
    full = np.sqrt(np.diag(together))
    if not np.all(full < DIVERGED):
        return None
    size = np.maximum(full, 1e-300)
    along = basis.T @ columns / size
    gram = together / size / size[:, None] - along.T @ along
    left = np.sqrt(np.clip(np.diag(gram), 0.0, None))
    # a column that the nuisance spans, or that is zero but for rounding, carries no information
    seen = (left > 1e-4) & (full > 1e-8 * np.max(full)) & (full > 0.0)
    if not np.any(seen):
        return None
    scale = left[seen]
    known, axes = np.linalg.eigh(gram[np.ix_(seen, seen)] / np.outer(scale, scale))
    score = (columns.T @ residual / size)[seen] / scale
    distinct = known > LEAST_INFORMATION * known[-1]
    solution = -axes[:, distinct] @ (axes[:, distinct].T @ score / known[distinct])
    coefficients = np.zeros(len(full))
    coefficients[seen] = solution / scale / full[seen]
    return coefficients, float(-score @ solution)
