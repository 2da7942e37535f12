"""Validation of an effect's parameter values from a scenario against the effect's bounds."""

from collections.abc import Mapping

from drake_cafim.effects.effect import CHANNEL_UNIT, Effect, Strength
from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import LARGEST, Range


def stated_values(kind: type[Effect], given: Mapping[str, float], key: str) -> dict[str, float]:
    """Values for all strengths of `kind`, those not `given` at their nominal value; shapes as given.

    `key` names the file and the entry. Raises `InputError` for an unknown parameter, for a value outside its bounds or
    not finite, and for a missing parameter without which the effect is not defined.
    """
    numbers = {strength.name: strength for strength in (*kind.strengths, *kind.shapes)}
    for name, value in given.items():
        if name not in numbers:
            raise InputError(f"{key}.{name}: {kind.name} has no such parameter; valid: {', '.join(numbers)}")
        if not allows(numbers[name], value):
            found = bounds(numbers[name]).words(value)
            raise InputError(f"{key}.{name} is {found}, expected {_words(numbers[name])}")
    for strength in kind.strengths:
        if strength.name not in given and is_required(strength, kind):
            raise InputError(f"{key}: {kind.name} needs {strength.name}, expected {_words(strength)}")
    amounts = [s.name for s in kind.strengths if s.amplitude and not s.through]
    if not any(name in given for name in amounts):
        raise InputError(f"{key}: {kind.name} needs at least one of {', '.join(amounts)}")
    return {s.name: s.nominal for s in kind.strengths} | dict(given)


def allows(strength: Strength, value: float) -> bool:
    """Whether the value is one of the strength's choices, or a finite number within its bounds."""
    return value in strength.choices if strength.choices else value in bounds(strength)


def bounds(strength: Strength) -> Range:
    """The strength's bounds with infinite ends replaced by ±`LARGEST`."""
    unit = "" if strength.unit == CHANNEL_UNIT else strength.unit
    return Range(max(strength.lower, -LARGEST), min(strength.upper, LARGEST), unit)


def is_required(strength: Strength, kind: type[Effect]) -> bool:
    """Whether a scenario must give the parameter: a payload's mass, but not its x, y, z, which default to 0."""
    return strength == kind.strengths[0] or not allows(strength, strength.nominal) or strength.required


def _words(strength: Strength) -> str:
    """The valid values in words, for an error message."""
    return " or ".join(f"{choice:g}" for choice in strength.choices) or str(bounds(strength))
