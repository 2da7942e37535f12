"""The figure of a law with several variables: the missing force and the effect's force over time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_cafim.diagnosis.fit.pictures import Evidence
from drake_cafim.report.colours import CORRECTED, INK
from drake_cafim.report.evidence import Picture, draw_law, draw_points, fit_limits
from drake_cafim.report.svg import as_svg
from drake_cafim.typing import Array

STRETCH = 3.0
"""s of the time strip."""


def over_time(evidence: Evidence) -> Picture:
    """The missing force without the effect and the effect's force, over the 3 s of its largest force, and as a scatter.

    The scatter is left out where the effect's force is constant.
    """
    given = [a - b for a, b in zip(evidence.without, evidence.with_it, strict=True)]
    row = _telling_row(evidence, given)
    label, unit = evidence.channels[row].label, evidence.channels[row].unit
    run = int(np.argmax([np.mean(values[:, row] ** 2) for values in given]))
    start = _telling_start(evidence.means[run].time, given[run][:, row])
    time = evidence.means[run].time
    shown = (time >= start) & (time <= start + STRETCH)
    x = np.concatenate([values[:, row] for values in given])
    y = np.concatenate([values[:, row] for values in evidence.without])
    constant = float(np.ptp(x)) < 1e-6 * float(np.max(np.abs(x)))
    figure = Figure(figsize=(6.6, 2.9), layout="constrained")
    grid = figure.subplots(1, 1 if constant else 2, squeeze=False, width_ratios=None if constant else [1.9, 1.0])[0]
    strip: Axes = grid[0]
    strip.plot(
        time[shown],
        evidence.without[run][shown, row],
        ".",
        color=INK,
        markersize=4.0,
        label="missing without the effect",
    )
    strip.plot(time[shown], given[run][shown, row], color=CORRECTED, linewidth=2.0, label="what the effect gives")
    strip.set_xlabel("time (s)")
    strip.set_ylabel(f"{label} ({unit})")
    strip.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0)
    if not constant:
        _against(grid[1], x, y, unit)
    svg = as_svg(figure, f"What is missing at {label} and what the effect gives")
    caption = f"The {STRETCH:g} s in which the effect is strongest, at {label}."
    if not constant:
        caption += " Right: all windows; the points lie on the line if the effect is all that the model lacks there."
    return Picture(svg, caption)


def _against(axes: Axes, x: Array, y: Array, unit: str) -> None:
    ends = np.array([np.min(x), np.max(x)])
    draw_law(axes, ends, ends)
    draw_points(axes, x, y)
    axes.set_xlabel(f"what the effect\ngives ({unit})")
    axes.set_ylabel(f"missing without the effect ({unit})")
    fit_limits(axes, y)


def _telling_row(evidence: Evidence, given: Sequence[Array]) -> int:
    """The row (equation) of the windows in which the effect is largest relative to the noise, forces preferred."""
    total = np.zeros(given[0].shape[1])
    for std, values in zip(evidence.std, given, strict=True):
        total += np.sum((values / std) ** 2, axis=0)
    dynamic = evidence.first_force
    # a force is easier to read than a disagreement of position and velocity
    return dynamic + int(np.argmax(total[dynamic:])) if np.any(total[dynamic:] > 0.0) else int(np.argmax(total))


def _telling_start(time: Array, values: Array) -> float:
    """Where the stretch begins in which `values` are largest."""
    sums = np.concatenate([[0.0], np.cumsum(values**2)])
    stop = np.searchsorted(time, time + STRETCH, side="right")
    inside = np.flatnonzero(time <= max(time[-1] - STRETCH, time[0]))
    best = inside[np.argmax(sums[stop[inside]] - sums[inside])]
    return float(time[best])
