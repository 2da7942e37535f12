"""Effects that a scenario states: from the entries of `effects:` to effects with their values."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.effects.learned_force import LearnedForce
from drake_cafim.effects.stated import stated_values
from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import ANY
from drake_cafim.scenario.law_table import read_law
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import CHANNELS, EffectEntry

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def known_effects(
    entries: Sequence[EffectEntry],
    physics: Physics,
    vocabulary: Sequence[type[Effect]],
    channels: Iterable[str],
    source: str,
    folder: Path | None = None,
    laws: Sequence[Effect] = (),
) -> list[Effect]:
    """The effects of `entries`, in their order.

    `vocabulary` holds the effect classes that may be named, `channels` the scenario's sensors (`wrench.wrist`,
    `pose.ball`). Tables of learned forces are in `folder`; those among `laws` are not read again. Raises `InputError`
    that names `source` (the file) and the key for an unknown effect, place or parameter, for a value out of range, and
    for an effect that is stated twice.
    """
    effects: list[Effect] = []
    channels = tuple(channels)
    for i, entry in enumerate(entries):
        key = f"{source}: effects[{i}]"
        effect = _learned(entry, physics, folder, laws, key) or known_effect(entry, physics, vocabulary, channels, key)
        twice = [k for k, other in enumerate(effects) if other == effect or _same(other, effect)]
        if twice:
            raise InputError(f"{key} states {effect.name} at {effect.at} a second time, after effects[{twice[0]}]")
        effects.append(effect)
    return effects


def _learned(
    entry: EffectEntry, physics: Physics, folder: Path | None, laws: Sequence[Effect], key: str
) -> Effect | None:
    """The learned force that the entry states, None where it states another effect."""
    if entry.effect != LearnedForce.name:
        if entry.table is not None:
            raise InputError(f"{key} has a table, which only a learned_force has")
        return None
    if not entry.table:
        raise InputError(f"{key}: learned_force has no table, expected the file of its terms")
    if entry.parameters or entry.interval or entry.recording is not None:
        raise InputError(f"{key}: learned_force has parameters, expected only at and table")
    known = [law for law in laws if (law.name, law.at, law.table) == (entry.effect, entry.at, entry.table)]
    law = known[0] if known else read_law(entry.at, (folder or Path()) / entry.table, entry.table, key)
    _check_place(law, physics, (), f"{key}.at")
    return law


def known_effect(
    entry: EffectEntry, physics: Physics, vocabulary: Sequence[type[Effect]], channels: Sequence[str], key: str
) -> Effect:
    """The effect of one entry, which messages call `key`; raises `InputError` as `known_effects` does."""
    effect = _effect(entry, vocabulary, key)
    _check_place(effect, physics, channels, f"{key}.at")
    contradiction = effect.contradiction_in(physics.with_effects([effect]).tree)
    if contradiction:
        raise InputError(f"{key}: {contradiction}")
    return effect


def _effect(entry: EffectEntry, vocabulary: Sequence[type[Effect]], key: str) -> Effect:
    for name in ("effect", "at"):
        if not getattr(entry, name):
            raise InputError(f"{key} has no {name}, expected a name")
    kind = effect_class(entry.effect, vocabulary, f"{key}.effect")
    given = dict(entry.parameters) | _named_law(entry, kind, key)
    if not kind.brief:
        if entry.interval or entry.recording is not None:
            raise InputError(f"{key} has interval or recording, which only an effect of limited duration has")
        effect = kind(entry.at, stated_values(kind, given, key))
    else:
        if len(entry.interval) != 2:
            raise InputError(f"{key} has no interval, expected `interval: [start, stop]` in s")
        for number in entry.interval:
            ANY.check(number, f"{key}.interval")
        for name in ("start", "stop"):
            if name in given:
                raise InputError(f"{key}.{name} is {given[name]:g}, expected the times under `interval` alone")
        start, stop = entry.interval
        names = [strength.name for strength in kind.strengths]
        given |= {name: value for name, value in (("start", start), ("stop", stop)) if name in names}
        effect = kind(entry.at, stated_values(kind, given, key)).during(start, stop, entry.recording)
    contradiction = effect.contradiction()
    if contradiction:
        raise InputError(f"{key}: {contradiction}")
    return effect


def _named_law(entry: EffectEntry, kind: type[Effect], key: str) -> dict[str, float]:
    """The number of the law that the entry names; raises `InputError` where the effect has no such choice."""
    if entry.law is None:
        return {}
    valid = next((dict(zip(s.names, s.choices, strict=True)) for s in kind.shapes if s.name == "law" and s.names), {})
    if entry.law not in valid:
        expected = f"expected one of {', '.join(valid)}" if valid else f"which {kind.name} does not have"
        raise InputError(f"{key}.law is {entry.law}, {expected}")
    return {"law": valid[entry.law]}


def effect_class(name: str, vocabulary: Sequence[type[Effect]], key: str) -> type[Effect]:
    """The class of the vocabulary of this name; raises `InputError` that names `key` where there is none."""
    try:
        return effect_named(name, vocabulary)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _same(first: Effect, second: Effect) -> bool:
    """Whether the two are the same effect at the same place; brief ones, as pushes, may occur more than once."""
    return first.key == second.key and not first.brief


def _check_place(effect: Effect, physics: Physics, channels: Sequence[str], key: str) -> None:
    """Raises `InputError` where the model, its contacts and its channels lack the effect's place."""
    if effect.of_contact:
        try:
            physics.with_effects([effect])
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
        return
    tree = physics.tree
    columns = [f"{kind}.{name}" for kind in CHANNELS[:3] for name in tree.joint_names]
    parts = [f"{name}.{part}" for name in channels for part in (WRENCH if name.startswith("wrench.") else POSE)]
    valid: Mapping[Place, Sequence[str]] = {
        Place.JOINT: tree.joint_names,
        Place.ACTUATOR: tree.joint_names,
        Place.BODY: [body.name for body in tree.bodies],
        Place.WORLD: ["world"],
        Place.CHANNEL: [*columns, *channels, *parts],
    }
    if effect.at not in valid[effect.place]:
        known = ", ".join(valid[effect.place]) or "none, the model has no such place"
        raise InputError(f"{key} is {effect.at}, expected one of {known}")
