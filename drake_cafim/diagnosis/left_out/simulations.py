"""Errors of simulations of parts that were left out, by models refitted without them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.predict.forecast import HORIZON, SHORT_HORIZON, Forecast
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.parallel.forked import map_forked
from drake_cafim.typing import Array, Flags


class Predictions(Protocol):
    """What models predict of parts of the recordings, several at once by as many processes as `jobs`."""

    @property
    def jobs(self) -> int:
        """-1 for one per core."""
        ...

    def simulate(self, model: Model, part: Part, horizon: float) -> Sequence[Forecast]:
        """Simulations of a part in windows of `horizon` s; none where no window begins in it."""
        ...

    def surprisal(self, model: Model, part: Part) -> float:
        """−ln likelihood of the innovations of a sample, the mean over a part; NaN where it cannot be computed."""
        ...


ByColumn = Mapping[str, float]
"""ln of the root mean square errors of a part's measured columns; none where the part cannot be simulated."""


@dataclass(frozen=True)
class Errors:
    """Of each part, by its measured columns, ln of the root mean square errors of simulations over both horizons.

    `diverges` (p,) tells whether a simulation of a second left a joint's range.
    """

    long: Sequence[ByColumn]
    short: Sequence[ByColumn]
    diverges: Flags

    def worse_than(self, other: "Errors") -> Array:
        """(p,) mean over columns of ln(own error/the other's) over 1 s, or over 0.1 s where one of the two diverges."""
        either = self.diverges | other.diverges
        return np.where(either, mean_differences(self.short, other.short), mean_differences(self.long, other.long))


def mean_differences(errors: Sequence[ByColumn], others: Sequence[ByColumn]) -> Array:
    """(p,) by part, the mean of ln(error/the other's) over the columns of which both are known; NaN where none is."""
    differences = []
    for own, other in zip(errors, others, strict=True):
        here = np.array([own[column] - other[column] for column in own if column in other])
        here = here[np.isfinite(here)]
        differences.append(float(np.mean(here)) if len(here) else np.nan)
    return np.array(differences)


def mean_with_error(values: Array) -> tuple[float, float]:
    """The mean of the known `values` (p,) and its standard error; (0, 0) where none is known, which decides nothing."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0
    error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else 0.0
    return float(np.mean(known)), error


def errors_over(
    predictions: Predictions, models: Sequence[Model], parts: Sequence[Part], horizon: float
) -> tuple[list[ByColumn], Flags]:
    """ln rms errors of each part over `horizon` s by the model that was fitted without it; (p,) whether any diverged.

    Once a joint has left its range its position there counts: the error of a simulation that diverges is large, and
    finite. What cannot be simulated at all counts as diverged, without an error.
    """

    def errors_in(number: int) -> tuple[ByColumn, bool]:
        found = compute(partial(predictions.simulate, models[number], parts[number], horizon))
        if isinstance(found, NotComputable):
            return {}, True
        return _ln_root_mean_square(found), any(forecast.diverges for forecast in found)

    found = list(map_forked(errors_in, len(parts), predictions.jobs))
    return [errors for errors, _ in found], np.array([diverged for _, diverged in found], dtype=bool)


def surprisals(predictions: Predictions, models: Sequence[Model], parts: Sequence[Part]) -> Array:
    """(p,) of each part −ln likelihood of a sample's innovation, the mean, by the model that was fitted without it."""

    def surprisal_in(number: int) -> float:
        return predictions.surprisal(models[number], parts[number])

    return np.array(list(map_forked(surprisal_in, len(parts), predictions.jobs)))


def _ln_root_mean_square(forecasts: Sequence[Forecast]) -> ByColumn:
    found = {}
    for column in {column for forecast in forecasts for column in forecast.predicted}:
        misses = np.concatenate([f.predicted[column] - f.measured[column] for f in forecasts if column in f.predicted])
        misses = misses[~np.isnan(misses)]
        if len(misses):
            with np.errstate(divide="ignore"):
                found[column] = float(0.5 * np.log(np.mean(misses**2)))
    return found


def both_horizons(predictions: Predictions, models: Sequence[Model], parts: Sequence[Part]) -> Errors:
    """The errors over 1 s and over 0.1 s."""
    long, diverges = errors_over(predictions, models, parts, HORIZON)
    short, _ = errors_over(predictions, models, parts, SHORT_HORIZON)
    return Errors(long, short, diverges)
