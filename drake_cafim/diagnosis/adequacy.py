"""Whether whitened rows look like unit white noise: goodness of fit in total, by row and by stretch of time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from drake_cafim.diagnosis.problem import Problem
from drake_cafim.typing import Array

BLOCK = 8
"""Windows in a stretch of time that is tested on its own: 0.24 s at the usual width."""
NOISE_TOLERANCE = 0.03
"""Stated standard deviations are taken to be right to this share; more is not held against the model."""


@dataclass(frozen=True)
class Adequacy:
    """The smallest of several p-values, times their number, and the share of χ² to expect."""

    p_value: float
    reduced_chi_square: float


def by_run(problem: Problem, rows: Array) -> Iterator[tuple[int, Array]]:
    """Each recording's whitened rows as (M, r)."""
    start = 0
    for index, run in enumerate(problem.runs):
        stop = start + run.shape[0] * run.shape[1]
        yield index, rows[start:stop].reshape(run.shape)
        start = stop


def adequacy(problem: Problem, residual: Array, fitted: int) -> Adequacy:
    """How well `residual` (whitened rows, then prior rows) agrees with unit white noise; `fitted` strengths."""
    rows = residual[: problem.rows]
    p_values: list[float] = []
    total = np.zeros(problem.runs[0].shape[1])
    count = 0
    for _, z in by_run(problem, rows):
        total += np.sum(z**2, axis=0)
        count += len(z)
        blocks = len(z) // BLOCK
        if blocks:
            per_block = np.sum(z[: blocks * BLOCK].reshape(blocks, BLOCK, -1) ** 2, axis=1)
            p = chi2.sf(per_block / (1.0 + NOISE_TOLERANCE) ** 2, BLOCK)
            p_values.append(float(min(1.0, p.min() * p.size * len(problem.runs))))
        if len(z) > 2:
            score = np.abs(np.sum(z[1:] * z[:-1], axis=0)) / np.sqrt(len(z) - 1)
            p = 2.0 * norm.sf(score / (1.0 + NOISE_TOLERANCE) ** 2)
            p_values.append(float(min(1.0, p.min() * p.size * len(problem.runs))))
    p = chi2.sf(total / (1.0 + NOISE_TOLERANCE) ** 2, max(count - fitted / len(total), 1.0))
    p_values.append(float(min(1.0, p.min() * p.size)))
    kinds = 3
    reduced = float(rows @ rows) / max(problem.rows - fitted, 1)
    return Adequacy(min(1.0, kinds * min(p_values)), reduced)
