"""Elements of the figures that show an effect's law over the data: the law's line, the points, the axes' limits."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from drake_cafim.report.colours import CORRECTED, INK
from drake_cafim.typing import Array, Indices

MOST_POINTS = 1400
"""Points drawn in one picture; more would enlarge the page without showing more."""


@dataclass(frozen=True)
class Picture:
    """A figure and the sentence under it."""

    svg: str
    caption: str


def draw_law(axes: Axes, grid: Array, law: Array) -> None:
    """Draw the law as a wide, pale line, so that points that lie on it stay visible."""
    axes.plot(grid, law, color=CORRECTED, linewidth=4.5, alpha=0.45, solid_capstyle="round", label="the law")


def draw_points(axes: Axes, x: Array, y: Array) -> None:
    """Draw at most `MOST_POINTS` of the points."""
    chosen = drawn_indices(len(x))
    axes.plot(x[chosen], y[chosen], "o", color=INK, markersize=2.2, markeredgewidth=0.0, alpha=0.4)


def drawn_indices(count: int) -> Indices:
    """Indices of at most `MOST_POINTS` of `count` points, a random sample with a fixed seed."""
    if count <= MOST_POINTS:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, MOST_POINTS, replace=False))


def fit_limits(axes: Axes, values: Array) -> None:
    """Set the vertical limits by the 0.3 % and 99.7 % quantiles of the values, so that a few outliers do not."""
    low, high = np.quantile(values, [0.003, 0.997])
    margin = 0.15 * max(float(high - low), 1e-12)
    axes.set_ylim(float(low) - margin, float(high) + margin)
