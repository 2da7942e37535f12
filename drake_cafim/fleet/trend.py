"""A strength over time: constant, drifting, or changed at some time."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from drake_cafim.typing import Array

Course = Literal["constant", "line", "step", "ramp"]
LEAST = 4
"""Fewest recordings at different times from which a change can be told."""
RISE = 3.84
"""Decrease of 2 ln likelihood at the ends of a 95 % interval of one parameter (χ², one degree of freedom)."""
PARAMETERS: dict[Course, int] = {"constant": 2, "line": 3, "step": 4, "ramp": 4}
"""Number of each course's parameters, the scatter between recordings and the time of the change among them."""
SCATTERS = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 61)])
"""Scatters between recordings that are tried, over the median std."""


@dataclass(frozen=True)
class Series:
    """A strength in recordings at `time` (n,), days, increasing; `value` (n,) with `std` (n,), in the same unit."""

    time: Array
    value: Array
    std: Array

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class Trend:
    """The likeliest course of a strength, and what it says.

    - `course`: "constant"; "line", drifting throughout; "step", another value from `onset` on; "ramp", constant until
      `onset`, then drifting.
    - `p_value`: the probability of as good a fit by a course that changes, of all that were tried in the fleet, where
      every strength is constant.
    - `since`: the 95 % interval of the onset, in days as the series, and `onset` its likeliest; of a line, the
      first recording: it began before.
    - `before`, `now`: the course's first and last value with their stds; `slope`: the
      drift at the end, per day, with the half width of its 95 % interval; None where it does not drift.
    - `scatter`: std between recordings beyond their own stds, of the course.
    - `fitted` (n,): the course at the recordings.
    """

    course: Course
    p_value: float
    since: tuple[float, float] | None
    onset: float | None
    before: tuple[float, float]
    now: tuple[float, float]
    slope: tuple[float, float] | None
    scatter: float
    fitted: Array


@dataclass(frozen=True)
class _Fit:
    course: Course
    onset: float
    scatter: float
    log_likelihood: float
    coefficients: Array
    covariance: Array
    columns: Array

    def criterion(self, count: int) -> float:
        """Schwarz's criterion, −2 ln L + k ln n."""
        return -2.0 * self.log_likelihood + PARAMETERS[self.course] * float(np.log(count))

    def squares(self, series: Series, other: "_Fit | None" = None) -> float:
        """Σ of squared residuals over the variances of this fit, or of `other`."""
        left = series.value - self.columns @ self.coefficients
        return float(np.sum(left**2 / (series.std**2 + (other or self).scatter ** 2)))


def trend_of(series: Series, tested: int) -> Trend:
    """The trend of a series, one of `tested` in the fleet.

    A course is fitted by weighted least squares with weights 1/(std² + scatter²); the scatter and the onset are those
    of the largest likelihood L, and the course is that of Schwarz's criterion. Its p-value is that of the F test of its
    second coefficient under its scatter, the stds taken for too small where more is left, times the courses, the onsets
    and the strengths that were tried (Bonferroni).
    """
    constant = _best(series, "constant", [0.0])
    moments = np.unique(series.time)
    if len(moments) < LEAST:
        return _summary(series, constant, 1.0, [constant])
    middles = 0.5 * (moments[:-1] + moments[1:])
    onsets = np.sort(np.concatenate([moments[:-1], middles[:-1]]))
    found: dict[Course, list[_Fit]] = {
        "line": [_best(series, "line", [float(moments[0])])],
        "step": [_best(series, "step", [float(at)]) for at in middles],
        "ramp": [_best(series, "ramp", [float(at)]) for at in onsets],
    }
    best = min((item for fits in found.values() for item in fits), key=lambda item: item.criterion(len(series)))
    trials = tested * sum(len(fits) for fits in found.values())
    freedom = len(series) - 2
    level = _fit(series, "constant", 0.0, np.array([best.scatter]))
    left = best.squares(series)
    gain = (level.squares(series, best) - left) / max(1.0, left / freedom)
    p_value = min(1.0, trials * float(fisher.sf(max(gain, 0.0), 1, freedom)))
    if best.criterion(len(series)) >= constant.criterion(len(series)) or p_value >= 1.0:
        return _summary(series, constant, p_value, [constant])
    return _summary(series, best, p_value, found[best.course])


def _best(series: Series, course: Course, onsets: list[float]) -> _Fit:
    """The fit of the largest likelihood over the onsets and the scatters."""
    scatters = float(np.median(series.std)) * SCATTERS
    return max((_fit(series, course, at, scatters) for at in onsets), key=lambda item: item.log_likelihood)


def _fit(series: Series, course: Course, onset: float, scatters: Array) -> _Fit:
    """The fit of the likeliest of the `scatters` (s,)."""
    variance = series.std**2 + scatters[:, None] ** 2
    columns = _columns(series.time, course, onset)
    information = np.einsum("ni,sn,nj->sij", columns, 1.0 / variance, columns)
    covariance = np.linalg.pinv(information, hermitian=True)
    coefficients = np.einsum("sij,sn,nj,n->si", covariance, 1.0 / variance, columns, series.value)
    left = series.value - coefficients @ columns.T
    likelihood = -0.5 * np.sum(left**2 / variance + np.log(2.0 * np.pi * variance), axis=1)
    k = int(np.argmax(likelihood))
    return _Fit(
        course, onset, float(scatters[k]), float(likelihood[k]), coefficients[k], np.asarray(covariance[k]), columns
    )


def _columns(time: Array, course: Course, onset: float) -> Array:
    """(n, 1) or (n, 2): what the coefficients of a course multiply."""
    item = np.ones_like(time)
    if course == "constant":
        return item[:, None]
    later = time > onset
    second = {"line": time - time[0], "step": later.astype(float), "ramp": np.where(later, time - onset, 0.0)}
    return np.stack([item, second[course]], axis=1)


def _summary(series: Series, best: _Fit, p_value: float, alike: list[_Fit]) -> Trend:
    """The trend of the best fit; `alike` are those of its course at other onsets."""
    fitted = np.asarray(best.columns @ best.coefficients, dtype=float)
    freedom = max(len(series) - len(best.coefficients), 1)
    ends = [(float(fitted[k]), float(np.sqrt(best.columns[k] @ best.covariance @ best.columns[k]))) for k in (0, -1)]
    slope = None
    if best.course in ("line", "ramp"):
        slope = float(best.coefficients[1]), _half_width(best, alike, float(student.ppf(0.975, freedom)))
    since = None if best.course == "constant" else _since(series, best, alike)
    onset = None if since is None else best.onset
    return Trend(best.course, p_value, since, onset, ends[0], ends[1], slope, best.scatter, fitted)


def _half_width(best: _Fit, alike: list[_Fit], reach: float) -> float:
    """Half the 95 % interval of the slope, `reach` stds of it at one onset, over all the likely onsets."""
    half = 0.0
    for item in alike:
        rise = 2.0 * (best.log_likelihood - item.log_likelihood)
        if rise < RISE:
            own = reach * float(np.sqrt(item.covariance[1, 1] * (1.0 - rise / RISE)))
            half = max(half, abs(float(item.coefficients[1] - best.coefficients[1])) + own)
    return half


def _since(series: Series, best: _Fit, alike: list[_Fit]) -> tuple[float, float]:
    """The 95 % interval of the onset, by profile likelihood: a step lies between two recordings."""
    likely = [item.onset for item in alike if 2.0 * (best.log_likelihood - item.log_likelihood) < RISE]
    if best.course == "line":
        return float(series.time[0]), float(series.time[0])
    moments = np.unique(series.time)
    first = moments[moments < min(likely)] if best.course == "step" else moments[moments <= min(likely)]
    last = moments[moments > max(likely)] if best.course == "step" else moments[moments >= max(likely)]
    return float(first[-1]), float(last[0])
