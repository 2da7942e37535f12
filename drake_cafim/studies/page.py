"""Writes a study's findings as one HTML page and as text."""

from pathlib import Path
from typing import get_args

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from drake_cafim.report import colours
from drake_cafim.studies.findings import Findings, Standing

SHADE = {"holds": "holds", "ties": "other", "does not hold": "fails", "cannot be repeated here": "other"}


def render(findings: Findings, command: str) -> str:
    """The page, byte-identical for equal findings; `command` is the command line that reproduces it."""
    folder = Path(__file__).parents[1] / "report"
    environment = Environment(loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("study.html.j2").render(
        findings=findings,
        counts=_counts(findings),
        command=command,
        shade=SHADE,
        ink=colours.INK,
        muted=colours.MUTED,
        hair=colours.HAIR,
        calm=colours.CALM,
        alarm=colours.ALARM,
    )


def as_text(findings: Findings) -> str:
    """Claims and tables in columns, for a terminal."""
    blocks = [findings.title]
    if findings.claims:
        blocks.append(", ".join(f"{standing}: {count}" for standing, count in _counts(findings).items()))
        blocks.append(_columns([(claim.standing, claim.claim, claim.found) for claim in findings.claims]))
    for table in findings.tables:
        blocks.append(f"{table.title}\n{_columns([table.header, *table.rows])}")
    return "\n\n".join(blocks)


def _counts(findings: Findings) -> dict[str, int]:
    """The number of claims by standing, without those that occur in none."""
    stand = [claim.standing for claim in findings.claims]
    return {standing: stand.count(standing) for standing in get_args(Standing) if standing in stand}


def _columns(rows: list[tuple[str, ...]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ["  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join(lines)
