"""Two explanations that compete: named by a user, or an accepted one and its rival in a report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.discrimination.planned import noise_of
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.effect import Effect, Strength
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.errors import InputError
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Pair:
    """Two models of one scene; each could be the truth."""

    first: Model
    second: Model

    @property
    def names(self) -> tuple[str, str]:
        """What each says is missing, as EFFECT@PLACE, without what both say."""
        common = {one.key for one in self.common.effects}
        sides = []
        for model in (self.first, self.second):
            own = [f"{name}@{at}" for name, at in (one.key for one in model.effects) if (name, at) not in common]
            sides.append(" + ".join(own) or "nothing more")
        return sides[0], sides[1]

    @property
    def common(self) -> Model:
        """What both say is missing, as the first has it."""
        both = {one.key for one in self.second.effects}
        return Model(self.first.unknown, tuple(one for one in self.first.effects if one.key in both))


def named_pair(scene: Scene, first: str, second: str) -> Pair:
    """The pair of two words EFFECT@PLACE, each effect at the size at which engineers meet it.

    Raises `InputError` for words that are none, effects and places that there are not, and twice the same.
    """
    if first == second:
        raise InputError(f"--between {first} {second}: expected two different explanations")
    unknown = scene.priors.mean
    models = [Model(unknown, (_typical(parsed(scene, word)),)) for word in (first, second)]
    return Pair(*models)


def parsed(scene: Scene, word: str) -> Effect:
    """The effect that EFFECT@PLACE names, without values; `InputError` lists the valid choices."""
    name, at, place = word.partition("@")
    if not at or not name or not place:
        raise InputError(f"--between {word}: expected EFFECT@PLACE, as actuator_bias@elbow")
    kind = effect_named(name)
    return placed(scene, kind, place, f"--between {word}")


def placed(scene: Scene, kind: type[Effect], place: str, source: str) -> Effect:
    """The effect at `place`; `source` stands in messages."""
    if issubclass(kind, ExternalDisturbance):
        raise InputError(f"{source}: a push from outside comes once, no motion of the robot brings it back")
    valid = places(scene, kind)
    if kind.place.value == "contact" and set(place.split("/")) in [set(one.split("/")) for one in valid]:
        return kind(place)
    if place not in valid:
        known = ", ".join(valid) or "none"
        raise InputError(f"{source}: {kind.name} cannot be at {place!r} in this scenario; valid places: {known}")
    return kind(place)


def places(scene: Scene, kind: type[Effect]) -> tuple[str, ...]:
    """Where in the scene the effect can be."""
    if issubclass(kind, SensorEffect):
        noisy = [column for column, std in noise_of(scene).items() if std > 0.0]
        return tuple(kind.sites(noisy))
    if issubclass(kind, ContactEffect | SurfaceEffect):
        return tuple(dict.fromkeys(kind.site(contact) for contact in scene.physics.contacts))
    return tuple(kind.places(scene.tree))


def _typical(effect: Effect) -> Effect:
    return effect.with_values({s.name: _size(s) for s in effect.strengths})


def _size(strength: Strength) -> float:
    value = strength.typical if strength.inverse else strength.nominal + strength.typical
    return float(np.clip(value, strength.lower, strength.upper))


def reported_pairs(scene: Scene, report: Mapping[str, Any], source: str) -> list[Pair]:
    """The accepted explanation of a report against each of its rivals, the most probable first.

    A rival takes the place of the accepted effect that it is most like; its strengths are typical ones. Raises
    `InputError` where the report has no rivals, and for effects that this scene cannot have.
    """
    if not report.get("rivals"):
        raise InputError(
            f"{source}: it has no rivals, the recordings told all explanations apart; "
            "name two with --between EFFECT@PLACE EFFECT@PLACE"
        )
    accepted = [_reported(scene, one, source) for one in report.get("explanation") or []]
    if not accepted:
        raise InputError(f"{source}: it has rivals but no explanation that they could rival")
    unknown = _unknown(scene, report, source)
    pairs = []
    for one in report["rivals"]:
        kind = effect_named(str(one["effect"]))
        rival = _typical(placed(scene, kind, str(one["at"]), source))
        replaced = _resembled(accepted, rival)
        others = tuple(effect for effect in accepted if effect is not replaced)
        pairs.append(Pair(Model(unknown, tuple(accepted)), Model(unknown, (*others, rival))))
    return pairs


def _reported(scene: Scene, entry: Mapping[str, Any], source: str) -> Effect:
    effect = placed(scene, effect_named(str(entry["effect"])), str(entry["at"]), source)
    return effect.with_values({name: float(one["value"]) for name, one in entry["parameters"].items()})


def _resembled(accepted: Sequence[Effect], rival: Effect) -> Effect:
    alike = [one for one in accepted if rival.name in one.alike or one.name in rival.alike]
    here = [one for one in (alike or accepted) if one.at == rival.at]
    return (here or alike or list(accepted))[0]


def _unknown(scene: Scene, report: Mapping[str, Any], source: str) -> Array:
    known = {(one["parameter"], one["at"]): float(one["value"]) for one in report.get("parameters", [])}
    lacking = [f"{one.parameter} of {one.at}" for one in scene.unknown if (one.parameter, one.at) not in known]
    if lacking:
        raise InputError(f"{source}: parameters lacks {', '.join(lacking)}; is it a report on this scenario?")
    return np.array([known[one.parameter, one.at] for one in scene.unknown], dtype=float)
