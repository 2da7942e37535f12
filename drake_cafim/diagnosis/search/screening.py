"""Score tests: how much each effect of the catalogue would gain, to first order, with the nuisance projected out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Candidate:
    """An effect to start an exact fit from, and what its linear look gains in χ²."""

    effect: Effect
    gain: float
    strengths: int
    trials: int
    """How many shapes were tried to find this one."""


RAN_AWAY = 1e100
"""A hidden state that was simulated with a value it is not stable for."""
LEAST_APART = 1e-9
"""Information on a combination of columns, against that on the best one, below which nothing tells them apart."""


def screen(problem: SearchProblem, at: Fit, effects: Sequence[Effect]) -> list[Candidate]:
    """The candidates by what they gain, largest first, given the fitted model `at`."""
    basis = np.linalg.qr(at.jacobian)[0] if at.jacobian.shape[1] else np.zeros((len(at.residual), 0))
    residual = at.residual - basis @ (basis.T @ at.residual)
    found = []
    for effect in effects:
        candidate = _best_look(problem, at, effect, basis, residual)
        if candidate is not None:
            gain = problem.gain_without_echo(at, candidate.effect, candidate.gain, basis)
            found.append(replace(candidate, gain=gain))
    return sorted(found, key=lambda candidate: -candidate.gain)


def _best_look(problem: SearchProblem, at: Fit, effect: Effect, basis: Array, residual: Array) -> Candidate | None:
    best: Candidate | None = None
    looks = problem.looks(at, effect)
    trials = looks.tried
    for columns, build in looks.found:
        trials += 1
        solved = _projected(columns, basis[: len(columns)], residual[: len(columns)])
        if solved is None:
            continue
        coefficients, gain = solved
        if best is not None and gain <= best.gain:
            continue
        built = build(coefficients)
        # a friction that drives or an inertia below zero is no explanation, however well it fits
        if built is not None and built.plausible():
            best = Candidate(built, gain, len(effect.strengths), 0)
    return None if best is None else Candidate(best.effect, best.gain, best.strengths, trials)


def _projected(columns: Array, basis: Array, residual: Array) -> tuple[Array, float] | None:
    """Coefficients of `columns` that take most off the residual once the nuisance is projected out, and what they take.

    `residual` is already orthogonal to the nuisance's orthonormal `basis`. None where the nuisance spans the columns.
    """
    # what ran away is no number at all once it is squared
    with np.errstate(over="ignore", invalid="ignore"):
        together = columns.T @ columns
    full = np.sqrt(np.diag(together))
    if not np.all(full < RAN_AWAY):
        return None
    size = np.maximum(full, 1e-300)
    along = basis.T @ columns / size
    gram = together / size / size[:, None] - along.T @ along
    left = np.sqrt(np.clip(np.diag(gram), 0.0, None))
    # a direction that the nuisance spans says nothing, nor one that all but rounding leaves alone
    seen = (left > 1e-4) & (full > 1e-8 * np.max(full)) & (full > 0.0)
    if not np.any(seen):
        return None
    scale = left[seen]
    known, axes = np.linalg.eigh(gram[np.ix_(seen, seen)] / np.outer(scale, scale))
    score = (columns.T @ residual / size)[seen] / scale
    told = known > LEAST_APART * known[-1]
    solution = -axes[:, told] @ (axes[:, told].T @ score / known[told])
    coefficients = np.zeros(len(full))
    coefficients[seen] = solution / scale / full[seen]
    return coefficients, float(-score @ solution)
