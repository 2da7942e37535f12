"""Effects that only `unknown:` names: a scenario need not state an effect whose numbers are all to be estimated."""

from collections.abc import Sequence

from drake_cafim.effects.effect import Effect, Strength
from drake_cafim.effects.stated import allows
from drake_cafim.errors import InputError
from drake_cafim.scenario.known_effects import effect_class, known_effect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import EffectEntry, Unknown
from drake_cafim.scenario.unknown import same_place


def effects_of_unknowns(
    entries: Sequence[Unknown],
    stated: Sequence[Effect],
    physics: Physics,
    vocabulary: Sequence[type[Effect]],
    channels: Sequence[str],
    source: str,
) -> list[Effect]:
    """The effects of the entries of `unknown:` that are not among those `stated`, their numbers at the prior means.

    Numbers without a mean, and those that no entry names, are at the value at which the effect is absent. Raises
    `InputError` that names `source` and the entry for an unknown effect, place or parameter, for a number that is
    needed and for an effect of limited duration, whose interval only `effects:` can state.
    """
    grouped: list[list[int]] = []
    for i, entry in enumerate(entries):
        if entry.effect is None or any(_same(entry, effect.name, effect.at) for effect in stated):
            continue
        for group in grouped:
            if _same(entry, str(entries[group[0]].effect), str(entries[group[0]].at)):
                group.append(i)
                break
        else:
            grouped.append([i])
    found = []
    for group in grouped:
        key = f"{source}: unknown[{group[0]}]"
        name, at = str(entries[group[0]].effect), str(entries[group[0]].at)
        kind = effect_class(name, vocabulary, f"{key}.effect")
        if kind.brief:
            raise InputError(f"{key}: {name} acts once; expected it under effects: too, with its interval")
        means = {entries[i].parameter: _mean(entries[i], kind, f"{source}: unknown[{i}]") for i in group}
        found.append(known_effect(EffectEntry(name, at, means), physics, vocabulary, channels, key))
    return found


def _same(entry: Unknown, name: str, at: str) -> bool:
    return entry.effect == name and same_place(at, entry.at or "")


def _mean(entry: Unknown, kind: type[Effect], key: str) -> float:
    numbers: dict[str, Strength] = {
        strength.name: strength for strength in (*kind.strengths, *kind.shapes) if not strength.choices
    }
    if entry.parameter not in numbers:
        raise InputError(
            f"{key}.parameter is {entry.parameter!r}, which {kind.name} lacks; valid: {', '.join(numbers)}"
        )
    strength = numbers[entry.parameter]
    if entry.mean is not None:
        return entry.mean
    if not allows(strength, strength.nominal):
        raise InputError(f"{key} ({entry.parameter} of {kind.name}) has no mean, expected that of its prior")
    return strength.nominal
