"""The figure of the unexplained force or reading at a place, against position, velocity, effort and time."""

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.diagnosis.fit.pictures import Remains
from drake_cafim.report.colours import ALARM, INK, MUTED
from drake_cafim.report.evidence import drawn_indices
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.typing import Array

BINS = 24
CONSTANT = 1e-6
"""Range of a variable over its size, below which it is drawn as a constant."""


def remains_figure(remains: Remains, place: str) -> str:
    """SVG: the residual at a place against each variable of `remains.against`, with medians by bins."""
    y, panels = remains.values, remains.against
    with page_style():
        figure = Figure(figsize=(9.4, 2.5), layout="constrained")
        chosen = drawn_indices(len(y))
        low, high = np.quantile(y, [0.005, 0.995])
        margin = 0.15 * max(float(high - low), 1e-12)
        for axes, (label, x) in zip(figure.subplots(1, len(panels), sharey=True), panels, strict=True):
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            axes.plot(x[chosen], y[chosen], "o", color=INK, markersize=2.0, markeredgewidth=0.0, alpha=0.25)
            axes.plot(*_trend(x, y), color=ALARM, linewidth=2.0)
            axes.set_xlabel(label)
            if np.ptp(x) < CONSTANT * np.max(np.abs(x)):
                axes.set_xlim(np.mean(x) - 0.5 * np.max(np.abs(x)), np.mean(x) + 0.5 * np.max(np.abs(x)))
            axes.set_ylim(float(low) - margin, float(high) + margin)
        figure.axes[0].set_ylabel(f"{remains.channel.label} ({remains.channel.unit})")
        return as_svg(figure, f"What remains at {place} against position, velocity, effort and time")


def _trend(x: Array, y: Array) -> tuple[Array, Array]:
    """Medians of y in bins that hold equally many points."""
    order = np.argsort(x, kind="stable")
    parts = [part for part in np.array_split(order, min(BINS, max(1, len(x) // 8))) if len(part)]
    return np.array([np.median(x[part]) for part in parts]), np.array([np.median(y[part]) for part in parts])
