"""Matplotlib figures as SVG elements for a page, byte-identical for equal numbers."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_cafim.report.colours import HAIR, INK, MUTED

STYLE: dict[Any, Any] = {
    "svg.hashsalt": "drake_cafim",
    "svg.fonttype": "none",  # letters stay letters: smaller, and they can be searched and copied
    "font.size": 9.0,
    "axes.edgecolor": HAIR,
    "axes.labelcolor": MUTED,
    "axes.titlecolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "axes.grid": True,
    "grid.color": HAIR,
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
}


@contextmanager
def page_style() -> Iterator[None]:
    """A context in which figures are made and written in the pages' style."""
    with rc_context(STYLE):
        yield


def as_svg(figure: Figure, description: str) -> str:
    """The figure as an `<svg>` element of full width; `description` is its text for screen readers."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # of no use, and not unique on a page with many figures
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    text = re.sub(r"\n\s*", "\n", text)
    box = re.search(r'viewBox="([^"]*)"', text)
    assert box is not None
    label = description.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    head = f'<svg viewBox="{box.group(1)}" role="img" aria-label="{label}">'
    return head + text[text.index(">") + 1 :].strip()


def hide_grid(axes: Axes) -> None:
    """Remove the grid and the tick marks."""
    axes.grid(visible=False)
    axes.tick_params(length=0)
