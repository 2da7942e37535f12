"""Effects that were tried in vain, and beside what: where another effect has come to their joint, they may stand."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import joint_of
from drake_cafim.diagnosis.search.pairs_by_place import Pair
from drake_cafim.effects.effect import Effect


@dataclass
class Refused:
    """What a search has tried in vain."""

    beside: dict[Key, frozenset[Key]] = field(default_factory=dict)
    """The effects that an explanation had at the joint of each effect that was refused."""
    pairs: set[frozenset[Key]] = field(default_factory=set)
    """Two effects with those whose place they took."""

    def add(self, effects: Iterable[Effect], model: Model) -> None:
        """`effects` were tried in vain beside those of `model`."""
        self.beside |= {effect.key: _at_joint_of(effect, model) for effect in effects}

    def holds(self, effect: Effect, model: Model) -> bool:
        """Whether `effect` was tried in vain beside what `model` has at its joint."""
        return self.beside.get(effect.key) == _at_joint_of(effect, model)

    def is_new(self, pair: Pair) -> bool:
        """Whether a pair has not been tried yet; from now on it has."""
        keys = frozenset(effect.key for effect in (*pair.effects, *pair.present))
        known = keys in self.pairs
        self.pairs.add(keys)
        return not known


def _at_joint_of(effect: Effect, model: Model) -> frozenset[Key]:
    joint = joint_of(effect)
    return frozenset(other.key for other in model.effects if joint_of(other) == joint)
