"""The vocabulary in words and formulas, for readers who have not met it."""

from dataclasses import dataclass
from html import escape

from drake_cafim.effects.effect import Effect


@dataclass(frozen=True)
class Law:
    """What an effect does, as an HTML formula and as a sentence's end."""

    formula: str
    words: str


def law_of(effect: Effect) -> Law:
    """The law of an effect; of one that has no formula, the first line of its documentation."""
    if effect.formula:
        return Law(effect.formula, effect.words)
    first = (type(effect).__doc__ or "").strip().split("\n")[0]
    return Law(escape(first), effect.words)
