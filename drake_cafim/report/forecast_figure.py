"""Simulations of a second each against what was recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.report.colours import CORRECTED, MEASURED, NOMINAL
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.typing import Array

LONGEST = 10.0
"""s that are shown; more would not be read."""
MOST_POINTS = 900
"""Of a line; more cannot be told apart."""


@dataclass(frozen=True)
class Contest:
    """One recording simulated by the nominal model, unknowns fitted, and by the corrected one where there is one."""

    nominal: Forecast
    corrected: Forecast | None


def telling_columns(
    nominal: Quality, corrected: Quality | None, measured: Mapping[str, Array], count: int
) -> list[str]:
    """The columns in which the effects gain most against the column's own range, or, without effects, the worst."""

    def miss(column: str) -> float:
        left = 0.0 if corrected is None else corrected.rmse.get(column, np.inf)
        span = float(np.nanmax(measured[column]) - np.nanmin(measured[column]))
        return float(np.sqrt(max(nominal.rmse[column] ** 2 - left**2, 0.0))) / max(span, 1e-12)

    known = [c for c, error in nominal.rmse.items() if c in measured and np.isfinite(error)]
    chosen = sorted(known, key=lambda column: -miss(column))[:count]
    return sorted(chosen, key=lambda column: (not column.startswith("q."), -miss(column)))


def forecast_figure(contest: Contest, columns: Sequence[str], units: Mapping[str, str]) -> str:
    """For each column what was measured and simulated, and beside it what the simulations miss."""
    with page_style():
        figure = Figure(figsize=(9.4, 0.5 + 1.75 * len(columns)), layout="constrained")
        grid = figure.subplots(len(columns), 2, squeeze=False, sharex=True, width_ratios=[1.35, 1.0])
        for axes, column in zip(grid, columns, strict=True):
            _followed(axes[0], contest, column)
            axes[0].set_title(f"{column} ({units[column]})")
            _missed(axes[1], contest, column)
            axes[1].set_title(f"simulated − measured ({units[column]})")
        for axis in grid[-1]:
            axis.set_xlabel("time (s)")
        handles, names = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=3)
        return as_svg(figure, "Simulation against recording, each window of a second started anew")


def _followed(axes: Axes, contest: Contest, column: str) -> None:
    shown = _shown(contest.nominal)
    time, nominal = _broken(contest.nominal, _simulated(contest.nominal, column), shown)
    _, measured = _broken(contest.nominal, contest.nominal.measured[column], shown)
    axes.plot(time, measured, color=MEASURED, linewidth=2.2, alpha=0.85, label="measured")
    axes.plot(time, nominal, color=NOMINAL, label="model without the effects" if contest.corrected else "model")
    if contest.corrected is not None:
        _, corrected = _broken(contest.corrected, _simulated(contest.corrected, column), shown)
        axes.plot(time, corrected, color=CORRECTED, label="with them")
    # a simulation that runs away must not hide the rest
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    margin = 0.45 * max(high - low, 1e-9)
    _within(axes, low - margin, high + margin)


def _missed(axes: Axes, contest: Contest, column: str) -> None:
    shown = _shown(contest.nominal)
    error = _simulated(contest.nominal, column) - contest.nominal.measured[column]
    time, nominal = _broken(contest.nominal, error, shown)
    axes.axhline(0.0, color=MEASURED, linewidth=0.8)
    axes.plot(time, nominal, color=NOMINAL)
    if contest.corrected is not None:
        error = _simulated(contest.corrected, column) - contest.corrected.measured[column]
        _, corrected = _broken(contest.corrected, error, shown)
        axes.plot(time, corrected, color=CORRECTED)
    limit = float(np.nanquantile(np.abs(nominal), 0.98)) * 1.3 or 1.0
    _within(axes, -limit, limit)


def _within(axes: Axes, low: float, high: float) -> None:
    """Show from `low` to `high`. Raises `FloatingPointError` where these are no numbers."""
    if not np.isfinite([low, high]).all():
        raise FloatingPointError("what is to be drawn is beyond numbers")
    axes.set_ylim(low, high)


def _shown(one: Forecast) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.asarray(one.time <= one.time[0] + LONGEST)


def _simulated(one: Forecast, column: str) -> Array:
    """What was simulated, NaN where the simulation has diverged."""
    return np.where(one.counted, one.predicted[column], np.nan)


def _broken(one: Forecast, values: Array, shown: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> tuple[Array, Array]:
    """Time and values with a gap between windows, thinned."""
    pieces_t, pieces_y = [], []
    stride = max(1, int(np.count_nonzero(shown) / MOST_POINTS))
    for window in np.unique(one.window[shown]):
        inside = np.flatnonzero(shown & (one.window == window))
        inside = np.unique(np.append(inside[::stride], inside[-1]))
        pieces_t.append(np.append(one.time[inside], np.nan))
        pieces_y.append(np.append(values[inside], np.nan))
    return np.concatenate(pieces_t), np.concatenate(pieces_y)
