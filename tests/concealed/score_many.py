"""A report against a truth of many effects, effect by effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .alike import Json, covered_by, matches

COULOMB, BIAS, ASYMMETRIC = "joint_coulomb_friction", "actuator_bias", "joint_asymmetric_coulomb_friction"
Names = Sequence[Sequence[str]]


def in_words_of(effects: Sequence[Json], named: Names) -> list[list[str]]:
    """The names, with Coulomb friction and a bias at one joint for friction unequal both ways, or the other way round.

    The two are the same torque, whatever moves; of both the truth has its own words.
    """
    true, told = {(item["effect"], item["at"]) for item in effects}, {(name, at) for name, at in named}
    for at in {at for _, at in told}:
        both, unequal = {(COULOMB, at), (BIAS, at)}, (ASYMMETRIC, at)
        if unequal in told and both <= true and unequal not in true and not both & told:
            told = (told - {unequal}) | both
        elif both <= told and unequal in true and not both & true and unequal not in told:
            told = (told - both) | {unequal}
    return sorted([name, at] for name, at in told)


def score_many(truth: Json, report: Json | None) -> dict[str, Any]:
    """Which of the effects are named, which of them are clear, and which names are of nothing that is there.

    An acceptable name counts for its effect. Without a report nothing is named.
    """
    effects = truth["effects"]
    told = [] if report is None else [[item["effect"], item["at"]] for item in report.get("explanation", [])]
    named = in_words_of(effects, told)
    clear = [bool(item["clear"]) for item in truth["strengths"]]
    found = [_is_named(effect, k, truth.get("accept", []), named) for k, effect in enumerate(effects)]
    known = [*effects, *truth.get("accept", [])]
    false = [name for name in named if not any(matches(name, effect) for effect in known)]
    return {
        "named": named,
        "wrong_names": false,
        "found": found,
        "clear_effects": clear,
        "right": all(there for there, sure in zip(found, clear, strict=True) if sure) and not false,
        "covered": [entry for item in (report or {}).get("explanation", []) for entry in _covered(effects, item)],
    }


def _is_named(effect: Json, own: int, accept: Sequence[Json], named: Names) -> bool:
    names = [effect, *(other for other in accept if other["of"] == own)]
    return any(matches(name, other) for name in named for other in names)


def _covered(effects: Sequence[Json], item: Mapping[str, Any]) -> list[list[Any]]:
    told = {name: (float(entry["value"]), float(entry.get("std") or 0.0)) for name, entry in item["parameters"].items()}
    same = [effect for effect in effects if matches([item["effect"], item["at"]], effect)]
    return [entry for effect in same for entry in covered_by(effect, told)]
