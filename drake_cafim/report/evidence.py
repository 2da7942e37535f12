"""What pictures of an effect's evidence share: the law's line, and the points that it is judged by."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from drake_cafim.report.colours import CORRECTED, INK
from drake_cafim.typing import Array, Indices

MOST_POINTS = 1400
"""In one picture; more would only weigh."""


@dataclass(frozen=True)
class Picture:
    """A figure and the sentence under it."""

    svg: str
    caption: str


def law_line(axes: Axes, grid: Array, law: Array) -> None:
    """The law, wide and pale: points that lie on it must not vanish under it."""
    axes.plot(grid, law, color=CORRECTED, linewidth=4.5, alpha=0.45, solid_capstyle="round", label="the law")


def points(axes: Axes, x: Array, y: Array) -> None:
    chosen = thinned(len(x))
    axes.plot(x[chosen], y[chosen], "o", color=INK, markersize=2.2, markeredgewidth=0.0, alpha=0.4)


def thinned(count: int) -> Indices:
    """Indices of at most `MOST_POINTS` of so many points, drawn without favour and always the same."""
    if count <= MOST_POINTS:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, MOST_POINTS, replace=False))


def fit_limits(axes: Axes, values: Array) -> None:
    """Limits that a few wild windows do not set."""
    low, high = np.quantile(values, [0.003, 0.997])
    margin = 0.15 * max(float(high - low), 1e-12)
    axes.set_ylim(float(low) - margin, float(high) + margin)
