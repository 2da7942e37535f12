"""Goodness-of-fit tests of whitened rows against unit white noise: by row, by stretch of time, and of neighbours."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import chi2, norm

from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import MISFIT_REDUCED_CHI_SQUARE, NOISE_STD_TOLERANCE, WINDOWS_PER_BLOCK
from drake_cafim.numerics.tail import SHARE, Tail
from drake_cafim.typing import Array

KINDS = 3
"""Number of kinds of statistics: by row, by stretch of time, and of neighbouring windows."""


@dataclass(frozen=True)
class Adequacy:
    """The smallest of several p-values, times their number (Bonferroni), and χ² per degree of freedom.

    Where the noise is no Gaussian one, see `Problem.realised_noise`, the p-value is how often noise alone leaves so
    small a one, if that is more.
    """

    p_value: float
    reduced_chi_square: float


def by_run(problem: Problem, rows: Array) -> Iterator[tuple[int, Array]]:
    """Index and whitened rows (M, r) of each recording: M windows of r rows."""
    start = 0
    for index, run in enumerate(problem.runs):
        stop = start + run.shape[0] * run.shape[1]
        yield index, rows[start:stop].reshape(run.shape)
        start = stop


@dataclass(frozen=True)
class Misfit:
    """The worst statistic of one `kind`, relative to its threshold, in units of the noise.

    - "stretch": mean square of a row over `WINDOWS_PER_BLOCK` windows of one recording;
    - "neighbours": correlation of a row's neighbouring windows, in standard deviations of chance;
    - "row": mean square of a row over all recordings.
    """

    kind: str
    statistic: float
    threshold: float
    """The value that noise alone exceeds at the requested rate."""
    row: int
    run: int | None
    windows: tuple[int, int] | None
    """First and last window of a stretch."""
    failing: int
    of: int
    """Number of statistics of this kind in all, `failing` of which exceed their threshold."""


@dataclass(frozen=True)
class _Group:
    """Statistics of one kind over one recording, or over all: (blocks, r) or (r,), and their p-values.

    `recordings` is the number of such groups; `level` gives the statistic that has a given p-value.
    """

    kind: str
    run: int | None
    statistic: Array
    p: Array
    recordings: int
    level: Callable[[float], float]


def adequacy(problem: Problem, residual: Array, fitted: int) -> Adequacy:
    """Test of `residual` (whitened rows, then prior rows) against noise; `fitted` strengths were fitted."""
    rows = residual[: problem.rows]
    reduced = float(rows @ rows) / max(problem.rows - fitted, 1)
    surprise = _surprise(problem, rows, fitted)
    tail = _tail(problem, surprise, reduced)
    return Adequacy(max(min(1.0, float(np.exp(-surprise))), tail.probability(surprise) if tail else 0.0), reduced)


def _surprise(problem: Problem, rows: Array, fitted: int) -> float:
    """−ln of the smallest p-value for Gaussian noise, times the number of them all; infinite where it underflows."""
    p = min(float(group.p.min()) * group.p.size * group.recordings for group in _groups(problem, rows, fitted))
    return -float(np.log(KINDS * p)) if p > 0.0 else np.inf


def _tail(problem: Problem, surprise: float, reduced: float) -> Tail | None:
    """The tail by which a misfit is judged that Gaussian noise would hardly leave, but other noise might."""
    worth = surprise > -np.log(SHARE) and reduced < MISFIT_REDUCED_CHI_SQUARE
    noise = problem.realised_noise if worth else None
    return None if noise is None else noise.tail(partial(_surprise, problem, fitted=0))


def misfits(problem: Problem, residual: Array, fitted: int, rate: float) -> tuple[Misfit, ...]:
    """The worst statistic of each kind in `adequacy`, whose p-value is below `rate` where one exceeds its threshold.

    `rate` is the probability that noise alone makes any statistic exceed its threshold.
    """
    kinds: dict[str, list[tuple[_Group, float]]] = {}
    rows = residual[: problem.rows]
    tail = _tail(problem, _surprise(problem, rows, fitted), float(rows @ rows) / max(problem.rows - fitted, 1))
    if tail is not None:
        rate = min(rate, float(np.exp(-tail.level(rate))))
    for group in _groups(problem, rows, fitted):
        level = group.level(rate / (KINDS * group.p.size * group.recordings))
        kinds.setdefault(group.kind, []).append((group, level))
    return tuple(_worst(kind, groups) for kind, groups in kinds.items())


def _worst(kind: str, groups: list[tuple[_Group, float]]) -> Misfit:
    group, level = max(groups, key=lambda of: float(np.max(of[0].statistic)) / of[1])
    at = np.unravel_index(int(np.argmax(group.statistic)), group.statistic.shape)
    windows = (
        (WINDOWS_PER_BLOCK * int(at[0]), WINDOWS_PER_BLOCK * int(at[0]) + WINDOWS_PER_BLOCK - 1)
        if len(at) == 2
        else None
    )
    failing = sum(int(np.count_nonzero(other.statistic > limit)) for other, limit in groups)
    of = sum(other.statistic.size for other, _ in groups)
    return Misfit(kind, float(np.max(group.statistic)), level, int(at[-1]), group.run, windows, failing, of)


def _groups(problem: Problem, rows: Array, fitted: int) -> Iterator[_Group]:
    """The statistics by which whitened `rows` are tested against unit white noise."""
    # the stated noise may be a little too small, which is no misfit of the model
    wider = (1.0 + NOISE_STD_TOLERANCE) ** 2
    total = np.zeros(problem.runs[0].shape[1])
    count, runs = 0, len(problem.runs)
    for run, z in by_run(problem, rows):
        total += np.sum(z**2, axis=0)
        count += len(z)
        blocks = len(z) // WINDOWS_PER_BLOCK
        if blocks:
            per_block = np.sum(z[: blocks * WINDOWS_PER_BLOCK].reshape(blocks, WINDOWS_PER_BLOCK, -1) ** 2, axis=1)
            p = chi2.sf(per_block / wider, WINDOWS_PER_BLOCK)
            yield _Group(
                "stretch",
                run,
                per_block / WINDOWS_PER_BLOCK,
                p,
                runs,
                lambda p: float(chi2.isf(p, WINDOWS_PER_BLOCK)) * wider / WINDOWS_PER_BLOCK,
            )
        if len(z) > 2:
            score = np.abs(np.sum(z[1:] * z[:-1], axis=0)) / np.sqrt(len(z) - 1)
            p = 2.0 * norm.sf(score / wider)
            yield _Group("neighbours", run, score, p, runs, lambda p: float(norm.isf(p / 2.0)) * wider)
    freedom = max(count - fitted / len(total), 1.0)
    p = chi2.sf(total / wider, freedom)
    yield _Group("row", None, total / freedom, p, 1, lambda p: float(chi2.isf(p, freedom)) * wider / freedom)
