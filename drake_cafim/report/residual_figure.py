"""The heat map of |residual| over time and row, without and with the accepted effects."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from drake_cafim.diagnosis.fit.pictures import ResidualMap
from drake_cafim.report.colours import RESIDUAL
from drake_cafim.report.svg import as_svg, hide_grid, page_style
from drake_cafim.report.wording import short
from drake_cafim.typing import Array

MOST_RECORDINGS = 6
COLUMNS = 320
"""Pixels across a panel; each shows the root mean square of the windows that fall into it."""
NOISE = 2.0
"""Standard deviations below which the map stays pale."""


def worst_first(maps: Sequence[ResidualMap]) -> list[ResidualMap]:
    """The `MOST_RECORDINGS` maps of largest mean square residual, in their own order."""
    order = sorted(range(len(maps)), key=lambda i: -float(np.mean(maps[i].before ** 2)))[:MOST_RECORDINGS]
    return [maps[i] for i in sorted(order)]


def residual_figure(maps: Sequence[ResidualMap], labels: Sequence[str], *, with_after: bool) -> str:
    """SVG, a row of panels per recording: |residual| in standard deviations; with `with_after` two columns."""
    with page_style():
        columns = 2 if with_after else 1
        panel = 0.35 + 0.17 * len(labels)
        height = panel * len(maps) + 1.05
        figure = Figure(figsize=(9.4, height), layout="constrained")
        grid = figure.subplots(len(maps), columns, squeeze=False, sharey=True)
        top = max(20.0, *(float(np.quantile(np.abs(m.before), 0.995)) for m in maps))
        norm = LogNorm(NOISE, top, clip=True)
        for row, (misfits, axes) in enumerate(zip(maps, grid, strict=True)):
            last = row == len(maps) - 1
            image = _panel(axes[0], misfits, misfits.before, labels, norm, last=last)
            if with_after:
                _panel(axes[1], misfits, misfits.after, labels, norm, last=last)
            axes[0].set_title(short(misfits.recording) + (", the model without the effects" if with_after else ""))
            if with_after:
                axes[1].set_title("with the effects")
        bar = figure.colorbar(
            image, ax=grid, location="top", shrink=0.42, aspect=42, pad=0.22 / height, anchor=(0.0, 0.0)
        )
        bar.set_label("misfit, in standard deviations of the noise", fontsize=8.5, loc="left")
        bar.set_ticks([t for t in (2, 5, 10, 30, 100, 300, 1000, 3000, 10000) if t <= top])
        bar.ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        bar.ax.minorticks_off()
        return as_svg(figure, "Misfit over time and channel" + (", without and with the effects" if with_after else ""))


def _panel(
    axes: Axes, misfits: ResidualMap, values: Array, labels: Sequence[str], norm: LogNorm, *, last: bool
) -> AxesImage:
    edges, picture = binned(misfits, values)
    colours = LinearSegmentedColormap.from_list("residual", RESIDUAL).with_extremes(bad="#ffffff")
    extent = (float(edges[0]), float(edges[-1]), len(labels) - 0.5, -0.5)
    image = axes.imshow(picture.T, aspect="auto", interpolation="none", cmap=colours, norm=norm, extent=extent)
    hide_grid(axes)
    for boundary in range(1, len(labels)):
        axes.axhline(boundary - 0.5, color="white", linewidth=1.0)
    axes.set_yticks(range(len(labels)), labels)
    if last:
        axes.set_xlabel("time (s)")
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    return image


def binned(misfits: ResidualMap, values: Array) -> tuple[Array, Array]:
    """Edges (P + 1,) s and the root mean square (P, r) of the windows in each bin of time; NaN where there are none."""
    start, stop = float(misfits.time[0] - 0.5 * misfits.width), float(misfits.time[-1] + 0.5 * misfits.width)
    count = int(min(COLUMNS, max(2, np.ceil((stop - start) / misfits.width))))
    edges = np.linspace(start, stop, count + 1)
    index = np.clip(np.searchsorted(edges, misfits.time, side="right") - 1, 0, count - 1)
    total, hits = np.zeros((count, values.shape[1])), np.zeros(count)
    np.add.at(total, index, values**2)
    np.add.at(hits, index, 1.0)
    filled = np.where(hits > 0, hits, np.nan)[:, None]
    return edges, np.sqrt(total / filled)
