"""Score tests: how much each effect of the catalogue would gain, to first order, with the nuisance projected out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis import looks as joint_looks
from drake_cafim.diagnosis.fitting import Fit
from drake_cafim.diagnosis.looks import Look
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.tosses import looks as toss_looks
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.pulses import strongest_pushes as strongest_tosses
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.coupling import JointCoupling
from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.physics import Physics
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
LEAST_ECHO = 8.0
"""Gain of a coupling that is worth asking whether it is an echo of noise."""


def hypotheses(problem: Problem) -> tuple[Effect, ...]:
    """Every effect of the vocabulary at every place where the recordings of `problem` could show it."""
    if isinstance(problem, TossProblem):
        return toss_looks.hypotheses(problem)
    assert isinstance(problem, WeakProblem)
    return joint_looks.hypotheses(problem)


def _looks(problem: Problem, at: Fit, effect: Effect) -> Iterator[Look]:
    if isinstance(problem, TossProblem):
        return toss_looks.looks(problem, at, effect)
    assert isinstance(problem, WeakProblem)
    return joint_looks.looks(problem, at, effect)


def _pushes_tried(problem: Problem, at: Fit) -> int:
    """How many pushes were looked at to find the strongest ones."""
    if isinstance(problem, TossProblem):
        return strongest_tosses(problem, at)[1]
    assert isinstance(problem, WeakProblem)
    return joint_looks.pushes(problem, at)[1]


def screen(problem: Problem, at: Fit, effects: Sequence[Effect]) -> list[Candidate]:
    """The candidates by what they gain, largest first, given the fitted model `at`."""
    basis = np.linalg.qr(at.jacobian)[0] if at.jacobian.shape[1] else np.zeros((len(at.residual), 0))
    residual = at.residual - basis @ (basis.T @ at.residual)
    found = []
    for effect in effects:
        candidate = _best_look(problem, at, effect, basis, residual)
        if candidate is not None and isinstance(candidate.effect, JointCoupling) and candidate.gain > LEAST_ECHO:
            assert isinstance(problem, WeakProblem)
            candidate = replace(candidate, gain=_without_echo(problem, at, candidate, basis))
        if candidate is not None:
            found.append(candidate)
    return sorted(found, key=lambda candidate: -candidate.gain)


def _best_look(problem: Problem, at: Fit, effect: Effect, basis: Array, residual: Array) -> Candidate | None:
    best: Candidate | None = None
    trials = 0
    for columns, build in _looks(problem, at, effect):
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
    if isinstance(effect, ExternalDisturbance):
        trials += _pushes_tried(problem, at)
    return None if best is None else Candidate(best.effect, best.gain, best.strengths, trials)


def _without_echo(problem: WeakProblem, at: Fit, candidate: Candidate, basis: Array) -> float:
    """What a coupling gains beyond what its drive, an effort that a controller made of noise, shares with the noise.

    As in `unbiased_fit`, the shared part is what one more dose of noise changes in both. What was looked at may be
    another spring than the one that it makes likely, whose own look may point elsewhere: the gain is the look's.
    """
    physics = at.model.physics(problem.scene)
    assert isinstance(candidate.effect, JointCoupling)
    column = _coupling_column(problem, physics, candidate.effect)
    louder = _coupling_column(problem.noisier_in_loop, physics, candidate.effect)
    noise = problem.noisier.residual(at.model) - at.residual
    noise = noise - basis @ (basis.T @ noise)
    rows = len(column)
    along = basis[:rows].T @ column
    left = max(float(column @ column - along @ along), 0.0)
    score = float(np.sqrt(candidate.gain * left)) + float((louder - column) @ noise[:rows])
    return score**2 / left if score > 0.0 and left > 0.0 else 0.0


def _coupling_column(problem: WeakProblem, physics: Physics, effect: JointCoupling) -> Array:
    """Whitened rows (R,) of a coupling with its values."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    parts = []
    for run in problem.runs:
        rows = np.zeros((len(run.weak.samples.windows), run.weak.rows_per_window))
        rows[:, run.weak.dynamic.start + joint] = run.weak.coupling_rows(physics, effect) / gain
        parts.append(run.whitened(rows))
    return np.concatenate(parts)


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
