"""The odds of two explanations given recordings, as a function of the recorded time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.evidence import Course, explain
from drake_cafim.discrimination.hypotheses import Pair
from drake_cafim.discrimination.scores import TWENTY_TO_ONE
from drake_cafim.typing import Array


@dataclass(frozen=True)
class OddsCourse:
    """Log odds (K,) of the first explanation against the second after `time` (K,) s of robot time."""

    time: Array
    log_odds: Array


def log_odds(problem: WeakProblem, pair: Pair, rows: int | None = None) -> float:
    """ln p(y | first)/p(y | second) with both models refitted, from the recordings' first `rows` whitened rows."""
    first = explain(problem, pair.first, rows=rows)
    second = explain(problem, pair.second, rows=rows)
    return first.log_evidence - second.log_evidence


def ends(problem: WeakProblem) -> tuple[Array, Array]:
    """The robot time (W,) s at which each window ends, and the number (W,) of whitened rows up to then."""
    times, rows, elapsed, counted = [], [], 0.0, 0
    for run in problem.runs:
        windows = run.weak.samples.windows
        times.append(elapsed + windows.starts + windows.width - windows.time[0])
        rows.append(counted + run.weak.rows_per_window * (1 + np.arange(len(windows))))
        elapsed += float(windows.time[-1] - windows.time[0])
        counted += run.rows
    return np.concatenate(times), np.concatenate(rows)


def course(problem: WeakProblem, pair: Pair, moments: Sequence[float]) -> OddsCourse:
    """The odds at `moments` s of robot time, with both models refitted to the rows up to each."""
    time, rows = ends(problem)
    found = []
    for moment in moments:
        known = int(np.searchsorted(time, moment + 1e-9, side="right"))
        found.append(log_odds(problem, pair, int(rows[known - 1])) if known else 0.0)
    return OddsCourse(np.array(moments, dtype=float), np.array(found))


def odds_along(problem: WeakProblem, pair: Pair) -> OddsCourse:
    """The odds at the end of every window, linearized at each explanation's fit to all of the recordings."""
    time, _ = ends(problem)
    first, second = (Course.of(problem, explain(problem, model)) for model in (pair.first, pair.second))
    return OddsCourse(time, first.log_evidence - second.log_evidence)


def settled_after(problem: WeakProblem, pair: Pair, sign: float, threshold: float = TWENTY_TO_ONE) -> float:
    """The robot time s after which `sign` × log odds first exceed `threshold`; infinite where they do not.

    By bisection over the windows, which assumes that the odds grow with the data.
    """
    time, rows = ends(problem)
    low, high = -1, len(rows) - 1
    if sign * log_odds(problem, pair, int(rows[high])) < threshold:
        return float("inf")
    while high - low > 1:
        middle = (low + high) // 2
        if sign * log_odds(problem, pair, int(rows[middle])) < threshold:
            low = middle
        else:
            high = middle
    return float(time[high])
