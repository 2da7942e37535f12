"""`cafim why`: says from a finished report why an effect was named, or was not."""

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from drake_cafim.commands.reports import read_report, report_file
from drake_cafim.diagnosis.trace import Record
from drake_cafim.errors import InputError
from drake_cafim.report.reasons import Reasons, effects_looked_for, number, reasons_of, story_of

SCHEMA = "drake_cafim.why/1"
LISTED = 12
"""Largest number of valid choices that a message lists."""


@dataclass(frozen=True)
class Traced:
    """The parts of a report that `cafim why` reads: its sentence, its trace, and the named effects."""

    sentence: str
    records: tuple[Record, ...]
    named: tuple[str, ...]


def why_command(report: Path, asked: str | None) -> dict[str, Any]:
    """The reasons as a mapping: of the effect `asked`, as EFFECT@PLACE, or of the whole verdict.

    Raises `InputError` for a report that cannot be read, and for an effect that was not looked for.
    """
    traced = read_trace(report)
    answer: dict[str, Any] = {"schema": SCHEMA, "verdict": traced.sentence}
    if asked is None:
        story = story_of(traced.records, traced.named)
        return answer | {
            "named": [_as_json(item) for item in story.named],
            "refused": [_as_json(item) for item in story.refused],
            "no_more": None if story.no_more is None else story.no_more.as_json(),
            "left": [item.as_json() for item in story.left],
        }
    _check(asked, report, effects_looked_for(traced.records))
    return answer | _as_json(reasons_of(traced.records, asked, traced.named))


def read_trace(report: Path) -> Traced:
    """The trace of the report in the file, or folder, `report`."""
    path = report_file(report)
    content = read_report(path, str(path))
    if not content.get("trace"):
        raise InputError(f"{path}: it holds no `trace`, expected a report of `cafim diagnose` of this version")
    try:
        records = tuple(Record.from_json(item) for item in content["trace"])
        named = tuple(f"{item['effect']}@{item['at']}" for item in content.get("explanation") or ())
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: its `trace` or `explanation` is damaged ({error}), expected a report.json") from None
    return Traced(str(content.get("sentence", "")), records, named)


def in_words(answer: dict[str, Any]) -> str:
    """The answer of `why_command` as text for a terminal."""
    if "asked" in answer:
        return "\n".join(_lines(answer))
    lines = [answer["verdict"], ""]
    for title, key in (("Why", "named"), ("Why not", "refused")):
        if answer[key]:
            lines += [title, *(f"  {item['sentence']}{_turn(item)}" for item in answer[key]), ""]
    if answer["no_more"]:
        lines += ["Why no further effect", f"  {answer['no_more']['words']}", ""]
    lines += ["What is left", *(f"  {item['words']}" for item in answer["left"])]
    return "\n".join(lines)


def _as_json(reasons: Reasons) -> dict[str, Any]:
    return {
        "asked": reasons.asked,
        "named": reasons.named,
        "sentence": f"{reasons.sentence[:1].upper()}{reasons.sentence[1:]}.",
        "turning": reasons.turning,
        "records": [item.as_json() for item in reasons.records],
        "rivals": [item.as_json() for item in reasons.rivals],
    }


def _lines(answer: dict[str, Any]) -> list[str]:
    lines = [answer["sentence"], *([f"For the other outcome: {answer['turning']}."] if answer["turning"] else []), ""]
    for item in answer["records"]:
        numbers = ""
        if item["statistic"] is not None and item["threshold"] is not None:
            numbers = f" [{number(item['statistic'])} against {number(item['threshold'])}]"
        lines.append(f"  {'+' if item['passed'] else '-'} {item['step']}: {item['words']}{numbers}")
    if answer["rivals"]:
        lines += ["", "Its rivals" if answer["named"] else "What was chosen instead"]
        lines += [f"  {item['asked']}: {item['words']}" for item in answer["rivals"]]
    return lines


def _turn(answer: dict[str, Any]) -> str:
    return f" For the other outcome: {answer['turning']}." if answer["turning"] else ""


def _check(asked: str, report: Path, valid: list[str]) -> None:
    effect, at, place = asked.partition("@")
    if not at or not effect or not place:
        raise InputError(f"{asked}: expected EFFECT@PLACE, as {valid[0] if valid else 'joint_spring@elbow'}")
    if asked in valid:
        return
    places = [name.partition("@")[2] for name in valid if name.partition("@")[0] == effect]
    if places:
        raise InputError(f"{asked}: {effect} was not looked for at {place} in {report}; valid places: {_few(places)}")
    effects = sorted({name.partition("@")[0] for name in valid})
    near = get_close_matches(effect, effects, LISTED, 0.5)
    raise InputError(f"{asked}: no effect {effect} was looked for in {report}; valid: {_few(near or effects)}")


def _few(names: list[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
