"""Figures of error and information against the number of experiments: medians and quartiles over seeds by policy."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.typing import Array

COLOURS = ("#2173d9", "#1d7a4d", "#d9820f", "#5d6b7a", "#7d1230", "#b3a1d6")


@dataclass(frozen=True)
class Curve:
    """One policy's errors (seeds, K+1) in percent, the prior's first, and information so far (seeds, K)."""

    name: str
    errors: Array
    information: Array


def quartile_figure(scenario: str, curves: Sequence[Curve]) -> str:
    """SVG of two panels: error and information so far, median and quartiles over seeds, one colour for each curve."""
    with page_style():
        figure = Figure(figsize=(7.2, 2.7), layout="constrained")
        left, right = figure.subplots(1, 2)
        for curve, colour in zip(curves, COLOURS, strict=True):
            for axes, values, first in ((left, curve.errors, 0), (right, curve.information, 1)):
                count = first + np.arange(values.shape[1])
                low, middle, high = np.percentile(values, [25, 50, 75], axis=0)
                axes.fill_between(count, low, high, color=colour, alpha=0.15, linewidth=0)
                axes.plot(count, middle, color=colour, marker="o", markersize=3, label=curve.name)
                axes.xaxis.set_major_locator(MaxNLocator(integer=True))
                axes.set_xlabel("experiments")
        left.set_title(f"{scenario}: error, %")
        right.set_title("information so far, scaled trace")
        right.set_yscale("symlog", linthresh=1.0)
        left.legend(fontsize=7)
        return as_svg(figure, f"Error and information by experiment for each policy, {scenario}")
