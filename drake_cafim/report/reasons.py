"""The reasons of a verdict, from the trace of its report: why an effect was named or refused, and why no further one.

Only the trace's records are read, so that a finished report is enough and no numerical code is loaded.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_cafim.diagnosis.trace import Record, spoken

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SHOWN = 5
"""Largest number of refused effects and of rivals that are listed."""
DECIDE = ("screen", "fit", "admit", "choose", "prune")
"""Steps whose outcome can refuse an effect."""


@dataclass(frozen=True)
class Reasons:
    """The decisions about one effect, and what would have changed their outcome."""

    asked: str
    named: bool
    sentence: str
    """Whether it was named, and the decision that settled it."""
    turning: str
    """What would have to be smaller, or larger, for the other outcome; empty where no number was compared."""
    records: tuple[Record, ...]
    """The decisions about it, in order."""
    rivals: tuple[Record, ...]
    """Of a named effect, the explanations that lost to it; of a refused one, the explanation that was chosen."""


@dataclass(frozen=True)
class Story:
    """A verdict's reasons: of each named effect, of the first refused ones, of no further one, and of what is left."""

    named: tuple[Reasons, ...]
    refused: tuple[Reasons, ...]
    no_more: Record | None
    left: tuple[Record, ...]


def records_of_verdict(records: Sequence[Record]) -> list[Record]:
    """The records of the search that led to the verdict (there may be further ones), and those of data mistakes."""
    search = next((record.search for record in reversed(records) if record.step == "verdict"), "")
    return [record for record in records if record.search == search or record.step == "data_mistake"]


def effects_looked_for(records: Sequence[Record]) -> list[str]:
    """Every `effect@place` in the records, in alphabetical order."""
    return sorted({name for record in records for name in (*record.effects, *record.others)})


def story_of(records: Sequence[Record], named: Sequence[str]) -> Story:
    """The reasons of the whole verdict; `named` are the accepted effects."""
    own = records_of_verdict(records)
    named = [*named, *far_unknowns(records)]
    refused: list[str] = []
    for step in ("rival", "choose", "admit", "fit", "screen"):
        for record in own:
            if record.step == step and record.effects and (step == "rival" or not record.passed):
                refused += [name for name in record.effects if name not in named and name not in refused]
    ends = [record for record in own if record.step == "another"]
    steps = ("data_mistake", "adequacy", "support", "unknown_forces", "far_unknown")
    left = [record for record in own if record.step in steps]
    far = [record for record in own if record.step == "remains" and not record.passed]
    return Story(
        tuple(reasons_of(own, name, named) for name in named),
        tuple(reasons_of(own, name, named) for name in refused[:SHOWN]),
        ends[-1] if ends and not ends[-1].passed else None,
        (*left, *far),
    )


def reasons_of(records: Sequence[Record], asked: str, named: Sequence[str]) -> Reasons:
    """The reasons for or against `asked`, one of `effects_looked_for`; `named` are the accepted effects."""
    own = [record for record in records_of_verdict(records) if asked in record.effects or asked in record.others]
    about = own or [record for record in records if asked in record.effects or asked in record.others]
    far = asked in far_unknowns(records)
    is_named = far or asked in named
    settled = deciding_record(about, is_named)
    if is_named:
        sentence = f"{spoken(asked)} is {'far from its prior' if far else 'named'}"
        steps = ("rival", "choose")
        others = [
            record for record in records_of_verdict(records) if record.step in steps and asked not in record.effects
        ]
        rivals = sorted(others, key=lambda record: steps.index(record.step))[:SHOWN]
    else:
        sentence = f"{spoken(asked)} is not named"
        rivals = [record for record in records_of_verdict(records) if record.step == "choose" and record.passed]
    sentence += f": {settled.words}" if settled else ""
    return Reasons(asked, is_named, sentence, turning(settled), tuple(about), tuple(rivals))


def far_unknowns(records: Sequence[Record]) -> list[str]:
    """The unknown parameters that are a mismatch by themselves, as `parameter@place`."""
    return [record.asked for record in records_of_verdict(records) if record.step == "far_unknown"]


def turning(record: Record | None) -> str:
    """What would have to be smaller, or larger, for the other outcome; empty where no number was compared."""
    if record is None or record.statistic is None or record.threshold is None:
        return ""
    side = "below" if record.statistic >= record.threshold else "above"
    what = record.test or "the statistic"
    if record.test == "criterion":
        what = "its lead in the information criterion"
    return f"{what} would have to be {side} {number(record.threshold)}; it is {number(record.statistic)}"


def number(value: float | None) -> str:
    """A statistic or a threshold to four digits."""
    if value is None:
        return "–"
    if 1e4 <= abs(value) < 1e6:
        text = f"{float(f'{value:.4g}'):,.0f}".replace(",", "\u202f")
    else:
        mantissa, cross, power = f"{value:.4g}".partition("e")
        text = mantissa + (f" × 10{str(int(power)).translate(SUPERSCRIPT)}" if cross else "")
    return text.replace("-", "−")


def deciding_record(about: Sequence[Record], named: bool) -> Record | None:
    """The record that decided: of a named effect its admission, else the refusal at the latest stage it reached."""
    steps = ("far_unknown", "admit", "choose", "prune") if named else DECIDE
    found = [record for record in about if record.step in steps and record.passed == named]
    if named:
        return next((record for step in steps for record in found if record.step == step), None)
    alone = [record for record in found if record.step not in ("choose", "fit") or len(record.effects) == 1]
    # the latest stage is compared with the strongest rivals; of several records the first, the best explanation with it
    for step in ("prune", "admit", "choose", "fit"):
        for record in [*alone, *found]:
            if record.step == step:
                return record
    screened = [record for record in found if record.step == "screen"]
    return screened[-1] if screened else None
