"""Formats numbers, probabilities, intervals and names for readers."""

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from drake_cafim.numerics.rounding import grouped, rounded

__all__ = ["rounded"]

NO_FIGURE = "–"
EFFICIENT, OVERCONFIDENT = 0.8, 1.25
"""Efficiencies within which an interval is as wide as the recordings make it."""
INTERVAL = 1.959964
"""Standard deviations to either side of a 95 % interval."""


def with_prefix(values: Sequence[float], unit: str) -> str:
    """The values, an arrow between them, in mm where metres would be small."""
    scale, name = (1e3, "mm") if unit == "m" and max(values) < 0.1 else (1.0, unit)
    return f"{' → '.join(rounded(scale * value) for value in values)} {name}"


def figure(value: float, digits: int = 3) -> str:
    """The rounded value, a dash where it could not be computed."""
    return NO_FIGURE if np.isnan(value) else rounded(value, digits)


def with_interval(value: float, std: float | None) -> str:
    """`value ± half-width` of the 95 % interval, both to two digits of the half-width; a choice has none."""
    if std is None:
        return f"{value:+g}".replace("-", "−")
    half = INTERVAL * std
    if not np.isfinite(half) or half <= 0.0:
        return rounded(value, 4)
    decimals = 1 - int(f"{half:.1e}".partition("e")[2])  # of the rounded half-width: 0.9996 is 1.0
    if decimals > 7 or max(abs(value), half) >= 1e6:
        return f"{rounded(value, 4)} ± {rounded(half, 2)}"
    places = max(decimals, 0)
    return f"{grouped(f'{value:.{places}f}')} ± {grouped(f'{half:.{places}f}')}".replace("-", "−")


def probability(p: float) -> str:
    """A probability in percent, never rounded to certainty."""
    if p > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if p < 0.001 else f"{100.0 * p:.1f} %"


def odds(log_odds: float) -> str:
    """e to the power `log_odds` as odds, as 250:1 or 1:12."""
    ratio = rounded(float(np.exp(min(abs(log_odds), 700.0))), 2)
    return f"{ratio}:1" if log_odds >= 0.0 else f"1:{ratio}"


def p_value(p: float) -> str:
    """A p-value as it is written after a sign."""
    return "< 10⁻¹⁵" if p < 1e-15 else f"= {rounded(p, 2)}"


def as_well(efficiency: float | None) -> str:
    """How well an interval uses the recordings; a full likelihood's would be √(1/efficiency) times as narrow."""
    if efficiency is None or not np.isfinite(efficiency) or efficiency <= 0.0:
        return ""
    if efficiency > OVERCONFIDENT:
        return "surer than these recordings can tell"
    if efficiency >= EFFICIENT:
        return "as well as these recordings can tell"
    return f"these recordings could tell it {rounded(float(efficiency**-0.5), 2)} times as closely"


def spoken(name: str) -> str:
    """An identifier in words."""
    return name.replace("_", " ")


def short(recording: str) -> str:
    """A recording's file name, without the folders that led to it."""
    return PurePath(recording).name or recording


def sentence_size(text: str) -> str:
    """The page's CSS class for a headline of this length."""
    return "brief" if len(text) < 160 else "long" if len(text) < 420 else "very-long"
