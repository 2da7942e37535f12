"""Pairs of competing explanations: named by a user, or the accepted one and a rival from a report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.discrimination.planned import noise_of
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect, Strength
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Pair:
    """Two competing models of one scene."""

    first: Model
    second: Model

    @property
    def names(self) -> tuple[str, str]:
        """The effects of each model that the other lacks, as EFFECT@PLACE joined by +; "nothing more" for none."""
        common = {effect.key for effect in self.common.effects}
        sides = []
        for model in (self.first, self.second):
            distinct = [f"{effect.name}@{effect.at}" for effect in model.effects if effect.key not in common]
            sides.append(" + ".join(distinct) or "nothing more")
        return sides[0], sides[1]

    @property
    def common(self) -> Model:
        """The model with the effects that both have, with the first model's values."""
        shared = {effect.key for effect in self.second.effects}
        return Model(self.first.unknown, tuple(effect for effect in self.first.effects if effect.key in shared))


def named_pair(scene: Scene, first: str, second: str) -> Pair:
    """The pair for two words EFFECT@PLACE, each effect at its typical strengths.

    Raises `InputError` for a word of another form, an unknown effect or place, and two equal words.
    """
    if first == second:
        raise InputError(f"--between {first} {second}: expected two different explanations")
    unknown = scene.priors.mean
    models = [Model(unknown, (_typical(parsed(scene, word)),)) for word in (first, second)]
    return Pair(*models)


def parsed(scene: Scene, word: str) -> Effect:
    """The effect that EFFECT@PLACE names, without values; `InputError` with the valid choices for an unknown one."""
    name, at, place = word.partition("@")
    if not at or not name or not place:
        raise InputError(f"--between {word}: expected EFFECT@PLACE, as actuator_bias@elbow")
    kind = effect_named(name)
    return placed(scene, kind, place, f"--between {word}")


def placed(scene: Scene, kind: type[Effect], place: str, source: str) -> Effect:
    """The effect at `place`, without values.

    Raises `InputError`, which begins with `source`, for an effect that acts once and for a place that is not valid.
    """
    if kind.brief:
        raise InputError(f"{source}: {kind.name} acts only once, so no motion of the robot can test for it")
    valid = places(scene, kind)
    if kind.place.value == "contact" and set(place.split("/")) in [set(pair.split("/")) for pair in valid]:
        return kind(place)
    if place not in valid:
        known = ", ".join(valid) or "none"
        raise InputError(f"{source}: {kind.name} cannot be at {place!r} in this scenario; valid places: {known}")
    return kind(place)


def places(scene: Scene, kind: type[Effect]) -> tuple[str, ...]:
    """The valid places of an effect of this class in the scene."""
    noisy = tuple(column for column, std in noise_of(scene).items() if std > 0.0)
    return tuple(kind.attachments(Surroundings(scene.tree, scene.physics.contacts, noisy)))


def _typical(effect: Effect) -> Effect:
    return effect.with_values({s.name: _size(s) for s in effect.strengths})


def _size(strength: Strength) -> float:
    value = strength.typical if strength.inverse else strength.nominal + strength.typical
    return float(np.clip(value, strength.lower, strength.upper))


def reported_pairs(scene: Scene, report: Mapping[str, Any], source: str) -> list[Pair]:
    """Pairs of a report's accepted explanation and each of its rivals, the most probable first.

    A rival replaces the accepted effect that it is most similar to; its strengths are typical ones. Raises
    `InputError` where the report has no rivals or no explanation, and for effects that this scene cannot have.
    """
    if not report.get("rivals"):
        raise InputError(
            f"{source}: it has no rivals, the recordings already tell all explanations apart; "
            "name two with --between EFFECT@PLACE EFFECT@PLACE"
        )
    accepted = [_effect_of(scene, entry, source) for entry in report.get("explanation") or []]
    if not accepted:
        raise InputError(f"{source}: it has rivals but no explanation that they could rival")
    unknown = _unknown(scene, report, source)
    rivals = [entry for entry in report["rivals"] if "effect" in entry]
    if not rivals:
        raise InputError(
            f"{source}: its rivals are unknown parameters of the scenario, expected an effect among them; "
            "weigh or measure the part, or name two effects with --between EFFECT@PLACE EFFECT@PLACE"
        )
    pairs = []
    for entry in rivals:
        kind = effect_named(str(entry["effect"]))
        rival = _typical(placed(scene, kind, str(entry["at"]), source))
        replaced = _most_similar(accepted, rival)
        others = tuple(effect for effect in accepted if effect is not replaced)
        pairs.append(Pair(Model(unknown, tuple(accepted)), Model(unknown, (*others, rival))))
    return pairs


def _effect_of(scene: Scene, entry: Mapping[str, Any], source: str) -> Effect:
    effect = placed(scene, effect_named(str(entry["effect"])), str(entry["at"]), source)
    return effect.with_values({name: float(number["value"]) for name, number in entry["parameters"].items()})


def _most_similar(accepted: Sequence[Effect], rival: Effect) -> Effect:
    alike = [effect for effect in accepted if rival.name in effect.alike or effect.name in rival.alike]
    here = [effect for effect in (alike or accepted) if effect.at == rival.at]
    return (here or alike or list(accepted))[0]


def _unknown(scene: Scene, report: Mapping[str, Any], source: str) -> Array:
    entries = report.get("parameters", [])
    known = {(entry["parameter"], entry["at"], entry.get("effect")): entry["value"] for entry in entries}
    lacking = [f"{unknown.parameter} of {unknown.at}" for unknown in scene.unknown if unknown.key not in known]
    if lacking:
        raise InputError(f"{source}: parameters lacks {', '.join(lacking)}; is it a report on this scenario?")
    return np.array([known[unknown.key] for unknown in scene.unknown], dtype=float)
