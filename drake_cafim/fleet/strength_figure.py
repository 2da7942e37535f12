"""The figure of one strength over time: its recordings, the likeliest course, and the sisters."""

from collections.abc import Sequence

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from drake_cafim.fleet.findings import Followed
from drake_cafim.report.colours import ALARM, CORRECTED, HAIR, MUTED
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.report.wording import INTERVAL, spoken


def strength_figure(item: Followed, sisters: Sequence[Followed]) -> str:
    """SVG: the strength in each recording with its 95 % interval, its course, its onset, the sisters in grey."""
    with page_style():
        figure = Figure(figsize=(6.4, 2.5), layout="constrained")
        axes = figure.subplots()
        for sister in sisters:
            axes.plot(sister.series.time, sister.series.value, color=HAIR, zorder=1)
        times = item.series.time
        axes.errorbar(
            times, item.series.value, INTERVAL * item.series.std, fmt="o", markersize=3.5, color=CORRECTED, zorder=3,
            elinewidth=1.0,
        )  # fmt: skip
        shown = np.array(item.trend.fitted)
        jump = int(np.argmax(np.abs(np.diff(shown)))) if item.trend.course == "step" else None
        if jump is None:
            axes.plot(times, shown, color=CORRECTED, linewidth=1.2, zorder=2)
        else:
            for part in (slice(None, jump + 1), slice(jump + 1, None)):
                axes.plot(times[part], shown[part], color=CORRECTED, linewidth=1.2, zorder=2)
        if item.trend.since is not None and item.trend.course != "line":
            axes.axvspan(*item.trend.since, color=ALARM, alpha=0.12, linewidth=0.0, zorder=0)
        locator = AutoDateLocator()
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        axes.tick_params(length=0, labelcolor=MUTED)
        axes.set_ylabel(f"{spoken(item.parameter)}{'' if item.unit == '1' else f', {item.unit}'}")
        return as_svg(figure, f"{spoken(item.effect)} at {item.at} of {item.robot} over time")
