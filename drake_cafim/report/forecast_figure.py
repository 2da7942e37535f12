"""The figure of simulations over windows of 1 s, nominal and corrected, against the recording."""

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
"""s from the recording's start that are shown; in a longer stretch single windows could not be seen."""
MOST_POINTS = 900
"""Points of a line; more cannot be told apart at its width."""


@dataclass(frozen=True)
class Forecasts:
    """Simulations of one recording by the nominal model, its unknowns fitted, and by the corrected model or None."""

    nominal: Forecast
    corrected: Forecast | None


def telling_columns(
    nominal: Quality, corrected: Quality | None, measured: Mapping[str, Array], count: int
) -> list[str]:
    """The `count` columns of largest √(rmse²(nominal) − rmse²(corrected)) relative to the range that was measured.

    Without effects the corrected rmse counts as zero. Positions stand first.
    """

    def gain(column: str) -> float:
        left = 0.0 if corrected is None else corrected.rmse.get(column, np.inf)
        span = float(np.nanmax(measured[column]) - np.nanmin(measured[column]))
        return float(np.sqrt(max(nominal.rmse[column] ** 2 - left**2, 0.0))) / max(span, 1e-12)

    known = [c for c, error in nominal.rmse.items() if c in measured and np.isfinite(error)]
    chosen = sorted(known, key=lambda column: -gain(column))[:count]
    return sorted(chosen, key=lambda column: (not column.startswith("q."), -gain(column)))


def forecast_figure(forecasts: Forecasts, columns: Sequence[str], units: Mapping[str, str]) -> str:
    """SVG: for each column, left the measurement and the simulations, right simulated − measured."""
    with page_style():
        figure = Figure(figsize=(9.4, 0.5 + 1.75 * len(columns)), layout="constrained")
        grid = figure.subplots(len(columns), 2, squeeze=False, sharex=True, width_ratios=[1.35, 1.0])
        for axes, column in zip(grid, columns, strict=True):
            _plot_simulations(axes[0], forecasts, column)
            axes[0].set_title(f"{column} ({units[column]})")
            _plot_errors(axes[1], forecasts, column)
            axes[1].set_title(f"simulated − measured ({units[column]})")
        for axis in grid[-1]:
            axis.set_xlabel("time (s)")
        handles, names = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=3)
        return as_svg(figure, "Simulation against recording, in windows of 1 s that start from the measured state")


def _plot_simulations(axes: Axes, forecasts: Forecasts, column: str) -> None:
    shown = _shown(forecasts.nominal)
    time, nominal = _with_gaps(forecasts.nominal, _simulated(forecasts.nominal, column), shown)
    _, measured = _with_gaps(forecasts.nominal, forecasts.nominal.measured[column], shown)
    axes.plot(time, measured, color=MEASURED, linewidth=2.2, alpha=0.85, label="measured")
    axes.plot(time, nominal, color=NOMINAL, label="model without the effects" if forecasts.corrected else "model")
    if forecasts.corrected is not None:
        _, corrected = _with_gaps(forecasts.corrected, _simulated(forecasts.corrected, column), shown)
        axes.plot(time, corrected, color=CORRECTED, label="with the effects")
    # a simulation that runs away must not hide the rest
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    margin = 0.45 * max(high - low, 1e-9)
    _set_limits(axes, low - margin, high + margin)


def _plot_errors(axes: Axes, forecasts: Forecasts, column: str) -> None:
    shown = _shown(forecasts.nominal)
    error = _simulated(forecasts.nominal, column) - forecasts.nominal.measured[column]
    time, nominal = _with_gaps(forecasts.nominal, error, shown)
    axes.axhline(0.0, color=MEASURED, linewidth=0.8)
    axes.plot(time, nominal, color=NOMINAL)
    if forecasts.corrected is not None:
        error = _simulated(forecasts.corrected, column) - forecasts.corrected.measured[column]
        _, corrected = _with_gaps(forecasts.corrected, error, shown)
        axes.plot(time, corrected, color=CORRECTED)
    limit = float(np.nanquantile(np.abs(nominal), 0.98)) * 1.3 or 1.0
    _set_limits(axes, -limit, limit)


def _set_limits(axes: Axes, low: float, high: float) -> None:
    """Show from `low` to `high`. Raises `FloatingPointError` where these are no numbers."""
    if not np.isfinite([low, high]).all():
        raise FloatingPointError("the values to draw are not finite")
    axes.set_ylim(low, high)


def _shown(simulated: Forecast) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.asarray(simulated.time <= simulated.time[0] + LONGEST)


def _simulated(simulated: Forecast, column: str) -> Array:
    """The simulated column, NaN where the simulation has diverged."""
    return np.where(simulated.counted, simulated.predicted[column], np.nan)


def _with_gaps(
    simulated: Forecast, values: Array, shown: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> tuple[Array, Array]:
    """Time and values of the windows, each followed by NaN, which breaks the line; at most about `MOST_POINTS`."""
    pieces_t, pieces_y = [], []
    stride = max(1, int(np.count_nonzero(shown) / MOST_POINTS))
    for window in np.unique(simulated.window[shown]):
        inside = np.flatnonzero(shown & (simulated.window == window))
        inside = np.unique(np.append(inside[::stride], inside[-1]))
        pieces_t.append(np.append(simulated.time[inside], np.nan))
        pieces_y.append(np.append(values[inside], np.nan))
    return np.concatenate(pieces_t), np.concatenate(pieces_y)
