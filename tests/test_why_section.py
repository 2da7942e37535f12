"""The page says in words and bars why each effect was named, and why others were not."""

import re
from html import unescape
from types import SimpleNamespace
from typing import Any

import pytest

from drake_cafim.diagnosis.trace import Record
from drake_cafim.report.reasons import number
from drake_cafim.report.why_section import why_section
from tests.test_why import NAMED, RECORDS, RIVAL


def verdict(records: list[dict[str, Any]]) -> Any:
    effect = SimpleNamespace(name=NAMED.partition("@")[0], at="elbow")
    trace = tuple(Record.from_json(record) for record in records)
    return SimpleNamespace(trace=trace, kind="unexplained", explanation=[SimpleNamespace(effect=effect)])


def words(html: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", html)).split())


def test_named_refused_no_further_and_what_remains() -> None:
    seen = words(why_section(verdict(RECORDS)))
    assert "Why joint coulomb friction at elbow" in seen and "gain would have to be below 17.9; it is 41.2" in seen
    assert (
        "Why not effect what decided number threshold joint stribeck friction at elbow Costs 9.2 more. −9.2 0" in seen
    )
    assert "Why no further effect Nothing more promises enough. 11 24" in seen
    assert "What would have to be smaller for “explained”" in seen and "below 2.3 it would pass. 14 2.3" in seen


def test_a_bar_ends_before_the_middle_where_a_number_is_below_its_threshold() -> None:
    lengths = [float(text) for text in re.findall(r'width="([0-9]+[.][0-9])"', why_section(verdict(RECORDS)))]
    assert min(lengths) < 50.0 < max(lengths)


def test_without_a_trace_there_is_no_section() -> None:
    assert why_section(verdict([])) == ""


def test_what_was_asked_is_no_markup() -> None:
    odd = [{**record, "words": "<b>bold</b> & more"} if record["asked"] == RIVAL else record for record in RECORDS]
    assert "<b>bold" not in why_section(verdict(odd))


@pytest.mark.parametrize(
    ("value", "text"),
    [(41.234, "41.23"), (-9.2, "−9.2"), (21233.9, "21\u202f230"), (3.5e6, "3.5 × 10⁶"), (1e-9, "1 × 10⁻⁹")],
)
def test_numbers_are_read_as_written(value: float, text: str) -> None:
    assert number(value) == text and number(None) == "–"
