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


def named_pair(scene: Scene, first: str, second: str, unknown: Array | None = None) -> Pair:
    """The pair for two words EFFECT@PLACE, each effect at its typical strengths, with the unknowns at `unknown` (n,).

    Without `unknown` they are at their prior means. Raises `InputError` for a word of another form, an unknown effect
    or place, and two equal words.
    """
    if first == second:
        raise InputError(f"--between {first} {second}: expected two different explanations")
    unknown = scene.priors.mean if unknown is None else unknown
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
    return tuple(kind.attachments(Surroundings(scene.tree, scene.physics.contacts, noisy, servos=scene.physics.servos)))


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
    if not any("effect" in entry for entry in report.get("rivals") or []):
        raise InputError(f"{source}: {_nothing_to_tell_apart(report)}; {_two_named(report)}")
    accepted = [_effect_of(scene, entry, source) for entry in report.get("explanation") or []]
    if not accepted:
        raise InputError(f"{source}: it has rivals but no explanation that they could rival")
    unknown = fitted_unknowns(scene, report, source)
    pairs = []
    for entry in (entry for entry in report["rivals"] if "effect" in entry):
        kind = effect_named(str(entry["effect"]))
        rival = _typical(placed(scene, kind, str(entry["at"]), source))
        replaced = _most_similar(accepted, rival)
        others = tuple(effect for effect in accepted if effect is not replaced)
        pairs.append(Pair(Model(unknown, tuple(accepted)), Model(unknown, (*others, rival))))
    return pairs


def _nothing_to_tell_apart(report: Mapping[str, Any]) -> str:
    """Why a report without rivals that are effects leaves no two explanations, and what to do, as a clause."""
    named = " and ".join(f"{entry['effect']}@{entry['at']}" for entry in report.get("explanation") or [])
    if rivals := report.get("rivals"):
        unknowns = " and ".join(f"{entry['parameter']} of {entry['at']}" for entry in rivals)
        return (
            f"the only rival of {named} is the unknown {unknowns}, and a motion is designed to tell effects apart; "
            f"measure {unknowns}, state the smaller std under unknown, and diagnose again"
        )
    if report.get("data_mistakes"):
        return "it has no rivals, because it tells of mistakes of the data; mend the recordings and diagnose again"
    if report.get("verdict") is None:
        return "it is of an estimation, which names no explanations; give the report of cafim diagnose"
    if not named:
        found = "nothing is missing" if report["verdict"] == "none" else "no effect is named"
        return f"it has no rivals, because {found}; cafim why says what was looked for"
    remains = "; what remains beside it is in no effect that could be tested for" * (report["verdict"] != "explained")
    return f"it has no rivals: the recordings already tell {named} from every other explanation{remains}"


def _two_named(report: Mapping[str, Any]) -> str:
    """How to ask for a motion all the same, as a clause."""
    first = next((f"{entry['effect']}@{entry['at']}" for entry in report.get("explanation") or []), "EFFECT@PLACE")
    return f"to design a motion for two explanations of your own, add --between {first} EFFECT@PLACE"


def _effect_of(scene: Scene, entry: Mapping[str, Any], source: str) -> Effect:
    effect = placed(scene, effect_named(str(entry["effect"])), str(entry["at"]), source)
    shown = {name: number["value"] for name, number in entry["parameters"].items()}
    return type(effect)(effect.at, effect.numbers(shown))


def _most_similar(accepted: Sequence[Effect], rival: Effect) -> Effect:
    alike = [effect for effect in accepted if rival.name in effect.alike or effect.name in rival.alike]
    here = [effect for effect in (alike or accepted) if effect.at == rival.at]
    return (here or alike or list(accepted))[0]


def fitted_unknowns(scene: Scene, report: Mapping[str, Any], source: str) -> Array:
    """The scene's unknowns (n,) as a report gives them. Raises `InputError` for a report that lacks one."""
    entries = report.get("parameters", [])
    known = {(entry["parameter"], entry["at"], entry.get("effect")): entry["value"] for entry in entries}
    lacking = [f"{unknown.parameter} of {unknown.at}" for unknown in scene.unknown if unknown.key not in known]
    if lacking:
        raise InputError(f"{source}: parameters lacks {', '.join(lacking)}; is it a report on this scenario?")
    return scene.vector_of(known)
