"""The law of an effect as a formula and in words, for the report's page."""

from dataclasses import dataclass
from html import escape

from drake_cafim.effects.effect import Effect


@dataclass(frozen=True)
class Law:
    """An effect's law: `formula` as HTML, and `words` that complete a sentence that begins with "It"."""

    formula: str
    words: str


def law_of(effect: Effect) -> Law:
    """The law of an effect; of one that has no formula, the first line of its documentation."""
    if effect.formula:
        return Law(effect.formula, effect.words)
    first = (type(effect).__doc__ or "").strip().split("\n")[0]
    return Law(escape(first), effect.words)
