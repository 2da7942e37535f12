"""The law of an effect as a formula and in words, for the report's page."""

from dataclasses import dataclass
from html import escape

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import SLIP
from drake_cafim.numerics.rounding import short

SIDE = "tanh(<i>v</i>/<i>w</i>)"
"""The side that dry friction is on, where it jumps; what builds up has another one."""


@dataclass(frozen=True)
class Law:
    """An effect's law: `formula` as HTML, and `words` that complete a sentence that begins with "It"."""

    formula: str
    words: str


def law_of(effect: Effect, tree: Tree) -> Law:
    """The law of an effect; of one that has no formula, the first line of its documentation."""
    if effect.values.get(SLIP.name):
        way = f"{short(effect.values[SLIP.name])} {effect.unit(SLIP, tree)}"
        words = f"{effect.words}; after the motion turned round it builds up over {way}: its side z goes from −1 to 1"
        return Law(effect.formula.replace(SIDE, "<i>z</i>"), words)
    if effect.formula:
        return Law(effect.formula, effect.words)
    first = (type(effect).__doc__ or "").strip().split("\n")[0]
    return Law(escape(first), effect.words)
