"""The section of a report's page on why each effect was named, and why others were not."""

from math import log10
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from drake_cafim.diagnosis.trace import Record, spoken
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.report import colours
from drake_cafim.report.reasons import Reasons, deciding_record, number, records_of_verdict, story_of

TEMPLATE = "why.html.j2"
DECADE = 1.0 / 6.0
"""Fraction of a bar's length for a factor of ten."""


def why_section(verdict: Verdict) -> str:
    """The section as HTML, empty where there is no trace."""
    if not verdict.trace:
        return ""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    named = [f"{item.effect.name}@{item.effect.at}" for item in verdict.explanation]
    story = story_of(verdict.trace, named)
    remains = [item for item in records_of_verdict(verdict.trace) if item.step == "remains" and item not in story.left]
    return environment.get_template(TEMPLATE).render(
        kind=verdict.kind,
        named=[_named(item) for item in story.named],
        refused=[_refused(item) for item in story.refused],
        no_more=None if story.no_more is None else _row(story.no_more),
        left=[_row(item) for item in (*story.left, *remains)],
    )


def _named(reasons: Reasons) -> dict[str, object]:
    tests = [item for item in reasons.records if item.step in ("test", "prune", "choose") and item.passed]
    return {"name": spoken(reasons.asked), "rows": [_row(item) for item in tests], "turning": reasons.turning}


def _refused(reasons: Reasons) -> dict[str, object]:
    settled = deciding_record(reasons.records, named=False)
    row = _row(settled) if settled else {"words": "", "statistic": "", "threshold": ""}
    return {"name": spoken(reasons.asked), **row}


def _row(record: Record) -> dict[str, object]:
    first = record.words[:1]
    # a capital χ would look like an X
    words = f"{first.upper() if first.isascii() else first}{record.words[1:]}."
    numbers = {"statistic": number(record.statistic), "threshold": number(record.threshold)}
    return {"words": words, "bar": _bar(record), **numbers}


def _bar(record: Record) -> str:
    """A bar as SVG whose length is the statistic on a logarithmic scale, with the threshold in the middle."""
    if not record.statistic or not record.threshold or min(record.statistic, record.threshold) <= 0.0:
        return ""
    reach = min(max(0.5 + DECADE * log10(record.statistic / record.threshold), 0.02), 1.0)
    colour = colours.CORRECTED if record.passed else colours.NOMINAL
    label = f"{number(record.statistic)} against {number(record.threshold)}"
    return (
        f'<svg viewBox="0 0 100 10" style="width:8rem" role="img" aria-label="{label}">'
        f'<rect x="0" y="3" width="100" height="4" fill="{colours.HAIR}"/>'
        f'<rect x="0" y="3" width="{100.0 * reach:.1f}" height="4" fill="{colour}"/>'
        f'<line x1="50" y1="0" x2="50" y2="10" stroke="{colours.INK}"/></svg>'
    )
