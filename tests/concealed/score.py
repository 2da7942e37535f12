"""A report against the opened truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from .alike import Json, covered_by, equivalent, matches, same_place
from .score_many import score_many
from .truth import FAMILY


def same_region(location: str, place: str) -> bool:
    """Whether a location points to the place: a surface may be meant by its pair, a channel by its sensor or joint."""
    if same_place(location, place):
        return True
    if "/" in location and place in location.split("/"):
        return True
    parts, other = place.split("."), location.split(".")
    return len(parts) > 1 and (location == parts[-1] or other == parts[: len(other)] or place in location)


def score(truth: Json, report: Json | None, failure: str = "") -> dict[str, Any]:
    """What was right and what was wrong; `report` None where the diagnosis failed."""
    effects = truth["effects"]
    kind = str(truth["kind"]).partition(":")[0]
    clear = [bool(item["clear"]) for item in truth.get("strengths", [])]
    result: dict[str, Any] = {
        "kind": kind,
        "rig": truth["rig"],
        "truth": [[item["effect"], item["at"]] for item in effects],
        "failure": failure,
        "strengths": [item["value"] for item in truth.get("strengths", [])],
        "sigmas": [item["sigma_beside_rival"] for item in truth.get("strengths", []) if "sigma_beside_rival" in item],
        "clear": bool(effects) and (any(clear) if kind == "many" else all(clear)),
        "process": bool(truth.get("settings", {}).get("process")),
    }
    if kind == "many":
        return result | {"verdict": "failed" if report is None else report["verdict"]} | score_many(truth, report)
    if report is None:
        return result | {"verdict": "failed", "named": [], "right": False, "right_as_before": False, "wrong_names": []}
    named = [[item["effect"], item["at"]] for item in report.get("explanation", [])]
    known = [*effects, *truth.get("accept", [])]
    wrong = [name for name in named if not any(matches(name, effect) for effect in known)]
    result |= {"verdict": report["verdict"], "named": named, "wrong_names": wrong}
    if kind == "null":
        return result | _score_null(truth, report, named)
    if kind == "odd":
        return result | _score_odd(effects[0], report, named)
    return result | _score_effects(truth, report, named) | _score_numbers(truth, report)


def _score_null(truth: Json, report: Json, named: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Any verdict but `none` is an alarm, and so is a mistake of the data that is not there.

    Noise that was not declared may be told of, as noise: beside `none`, that is no alarm. `right_as_before` is the
    count of 0.1.0, by which such a remark excused any verdict `unexplained`.
    """
    alarm = bool(named) or report["verdict"] != "none"
    remarks = [*(report.get("data_mistakes") or []), *(report.get("noise_remarks") or [])]
    mistakes = [json.dumps(item).lower() for item in remarks]
    before = alarm or bool(mistakes)
    if truth["noise"]["kind"] == "coloured_undeclared":
        mistakes = [words for words in mistakes if "noise" not in words]
        if not named:
            spoken = json.dumps([remarks, report.get("mismatch")]).lower()
            before = report["verdict"] == "explained" or (before and "noise" not in spoken)
    alarm = alarm or bool(mistakes)
    return {"right": not alarm, "false_alarm": alarm, "right_as_before": not before}


def _score_odd(effect: Json, report: Json, named: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Nothing of the vocabulary is there, so that every name is a wrong one, under whichever verdict it stands.

    `right_as_before` and `misnamed_as_before` are the count of 0.1.0, which looked at the verdict alone.
    """
    return {
        "right": report["verdict"] == "unexplained" and not named,
        "misnamed": bool(named) or report["verdict"] == "explained",
        "missed": report["verdict"] == "none",
        "place": _located(effect["at"], report),
        "right_as_before": report["verdict"] == "unexplained",
        "misnamed_as_before": report["verdict"] == "explained",
    }


def _located(place: str, report: Json) -> bool:
    locations = report.get("mismatch", {}).get("locations", [])
    top = locations[0]["name"] if locations else ""
    return same_region(top, place) or any(same_region(item["at"], place) for item in report.get("explanation", []))


def _replaces(other: Json, effects: Sequence[Json], named: Sequence[Sequence[str]], report: Json) -> bool:
    """Whether what is named is the truth with one effect, the `of`-th, under the acceptable name; never two at once."""
    wanted = [effect for k, effect in enumerate(effects) if k != other.get("of", 0)]
    if other["effect"] != "none":
        wanted.append(other)
    elif not wanted and report["verdict"] != "none":
        return False
    return len(named) == len(wanted) and all(any(matches(name, effect) for name in named) for effect in wanted)


def _score_effects(truth: Json, report: Json, named: Sequence[Sequence[str]]) -> dict[str, Any]:
    effects = truth["effects"]
    found = [any(matches(name, effect) for name in named) for effect in effects]
    exact = all(found) and len(named) == len(effects)
    second = not exact and any(_replaces(other, effects, named, report) for other in truth.get("accept", []))
    families = [any(FAMILY.get(name[0]) == FAMILY.get(effect["effect"]) for name in named) for effect in effects]
    return {
        "right": exact or second,
        "right_as_before": exact or second,
        "exact": exact,
        "second_name": second,
        "found": found,
        "family": all(families) or second,
        "place": all(_located(effect["at"], report) for effect in effects),
        "extra": max(0, len(named) - len(effects)),
        "missed": not named,
        "ended_unexplained": report["verdict"] == "unexplained",
    }


def _score_numbers(truth: Json, report: Json) -> dict[str, Any]:
    """Errors of strengths, coverage of 95 % intervals, transients' intervals, held-out likelihood."""
    errors, covered = [], []
    for effect in truth["effects"]:
        true = {name: float(value[0]) for name, value in effect["parameters"].items()}
        for item in report.get("explanation", []):
            if not matches([item["effect"], item["at"]], effect):
                continue
            parameters = item["parameters"].items()
            told = {name: (float(entry["value"]), float(entry.get("std") or 0.0)) for name, entry in parameters}
            first = next(iter(true))
            if first in told:
                value = equivalent(effect["effect"], {name: number for name, (number, _) in told.items()}, true)[first]
                errors.append(_relative(effect["effect"], value, true[first]))
            covered += covered_by(effect, told)
    return {
        "errors": errors,
        "covered": covered,
        # a push in one of the other recordings says nothing of those held out
        "held_out_gain": None if all("interval" in effect for effect in truth["effects"]) else _gain(report),
        "transient": _transient(truth, report),
    }


def _relative(effect: str, told: float, true: float) -> float:
    """Relative error; of a gain, of what it differs from one by."""
    if effect in ("actuator_gain_error", "sensor_gain_error"):
        told, true = told - 1.0, true - 1.0
    return abs(told - true) / max(abs(true), 1e-12)


def _gain(report: Json) -> float | None:
    held = (report.get("fit") or {}).get("held_out")
    if not held or not held.get("nominal") or not held.get("corrected") or not report.get("explanation"):
        return None
    nominal, corrected = held["nominal"].get("nll"), held["corrected"].get("nll")
    return None if nominal is None or corrected is None else float(nominal) - float(corrected)


def _transient(truth: Json, report: Json) -> dict[str, float] | None:
    """Of a pulse: the centre's error (s) and intersection over union with the best interval told in its recording."""
    for effect in truth["effects"]:
        if "interval" not in effect:
            continue
        first, last = effect["interval"]
        best = {"centre_error": float("inf"), "overlap": 0.0}
        for location in report.get("mismatch", {}).get("locations", []):
            if location.get("recording") not in (effect["recording"], None):
                continue
            for start, stop in location.get("intervals", []):
                union = max(last, stop) - min(first, start)
                overlap = max(0.0, min(last, stop) - max(first, start)) / union
                if overlap >= best["overlap"]:
                    best = {"centre_error": abs(0.5 * (start + stop) - 0.5 * (first + last)), "overlap": overlap}
        return best
    return None
