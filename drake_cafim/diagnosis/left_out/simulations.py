"""Errors of simulations of parts that were left out, by models refitted without them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.predict.forecast import HORIZON, SHORT_HORIZON, Forecast
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.typing import Array, Flags


class Predictions(Protocol):
    """What models predict of parts of the recordings."""

    def simulate(self, model: Model, part: Part, horizon: float) -> Sequence[Forecast]:
        """Simulations of a part in windows of `horizon` s; none where no window begins in it."""
        ...

    def surprisal(self, model: Model, part: Part) -> float:
        """−ln likelihood of the innovations of a sample, the mean over a part; NaN where it cannot be computed."""
        ...


@dataclass(frozen=True)
class Errors:
    """Of each part (p,), by its measured columns (p, c): ln of the root mean square errors of simulations.

    NaN where there is none. `diverges` (p,) tells whether a simulation of a second left a joint's range.
    """

    long: Array
    short: Array
    diverges: Flags

    def worse_than(self, other: "Errors") -> Array:
        """(p,) mean over columns of ln(own error/the other's) over 1 s, or over 0.1 s where one of the two diverges."""
        over_second, shortly = self.long - other.long, self.short - other.short
        either = (self.diverges | other.diverges)[:, None]
        difference = np.where(either, shortly, over_second)
        return mean_of_known(difference)


def mean_of_known(values: Array) -> Array:
    """(p,) means of the numbers in each row of `values` (p, c) that are known; NaN where none is."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, values, 0.0), axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def mean_with_error(values: Array) -> tuple[float, float]:
    """The mean of the known `values` (p,) and its standard error; (0, 0) where none is known, which decides nothing."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0
    error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else 0.0
    return float(np.mean(known)), error


def errors_over(
    predictions: Predictions, models: Sequence[Model], parts: Sequence[Part], horizon: float
) -> tuple[Array, Flags]:
    """ln rms errors (p, c) of each part over `horizon` s by the model that was fitted without it; whether any diverged.

    Once a joint has left its range its position there counts: the error of a simulation that diverges is large, and
    finite. What cannot be simulated has an infinite one.
    """
    rows: list[dict[str, float] | None] = []
    diverged = np.zeros(len(parts), dtype=bool)
    for k, (model, part) in enumerate(zip(models, parts, strict=True)):
        found = compute(partial(predictions.simulate, model, part, horizon))
        if isinstance(found, NotComputable):
            rows.append(None)
            diverged[k] = True
            continue
        rows.append(_root_mean_square(found))
        diverged[k] = any(forecast.diverges for forecast in found)
    columns = sorted({column for row in rows if row is not None for column in row})
    table = [[np.inf] * len(columns) if row is None else [row.get(c, np.nan) for c in columns] for row in rows]
    with np.errstate(divide="ignore"):
        return np.log(np.array(table).reshape(len(parts), len(columns))), diverged


def _root_mean_square(forecasts: Sequence[Forecast]) -> dict[str, float]:
    found = {}
    for column in {column for forecast in forecasts for column in forecast.predicted}:
        misses = np.concatenate([f.predicted[column] - f.measured[column] for f in forecasts if column in f.predicted])
        misses = misses[~np.isnan(misses)]
        if len(misses):
            found[column] = float(np.sqrt(np.mean(misses**2)))
    return found


def both_horizons(predictions: Predictions, models: Sequence[Model], parts: Sequence[Part]) -> Errors:
    """The errors over 1 s and over 0.1 s."""
    long, diverges = errors_over(predictions, models, parts, HORIZON)
    short, _ = errors_over(predictions, models, parts, SHORT_HORIZON)
    return Errors(long, short, diverges)
