"""`cafim why` answers from a finished report alone, soon, and says what it cannot answer."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from drake_cafim.cli import main

NAMED, RIVAL, BOTH = "joint_coulomb_friction@elbow", "joint_stribeck_friction@elbow", "payload@link3"
RECORDS: list[dict[str, Any]] = [
    {"step": "screen", "asked": "the others", "statistic": 7.5, "threshold": 812.0, "passed": False,
     "words": "one of 2 further candidates that lower χ² by at most 7.5 each, to first order",
     "others": ["payload@link2", BOTH]},
    {"step": "admit", "asked": NAMED, "statistic": 41.2, "threshold": 17.9, "passed": True,
     "words": "it passed all 4 tests", "test": "gain"},
    {"step": "another", "asked": "effect number 2", "statistic": 11.0, "threshold": 24.0, "passed": False,
     "words": "nothing more promises enough", "beside": NAMED},
    {"step": "choose", "asked": NAMED, "statistic": 9.2, "threshold": 0.0, "passed": True,
     "words": "chosen", "test": "criterion", "beside": RIVAL},
    {"step": "choose", "asked": RIVAL, "statistic": -9.2, "threshold": 0.0, "passed": False,
     "words": "costs 9.2 more", "test": "criterion", "beside": NAMED},
    {"step": "adequacy", "asked": NAMED, "statistic": 1e-9, "threshold": 0.01, "passed": False,
     "words": "something remains", "test": "p-value"},
    {"step": "remains", "asked": "elbow: forces", "statistic": 14.0, "threshold": 2.3, "passed": False,
     "words": "elbow: forces: its mean square is 14 times that of noise; below 2.3 it would pass", "test": "stretch"},
    {"step": "verdict", "asked": "unexplained", "statistic": None, "threshold": None, "passed": False, "words": "more"},
]  # fmt: skip


@pytest.fixture
def report(tmp_path: Path) -> Path:
    content = {
        "schema": "drake_cafim.report/1",
        "verdict": "unexplained",
        "sentence": "The model lacks joint coulomb friction at elbow.",
        "explanation": [{"effect": "joint_coulomb_friction", "at": "elbow", "probability": 0.97}],
        "trace": RECORDS,
    }
    (tmp_path / "report.json").write_text(json.dumps(content))
    return tmp_path


def why(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["why", *(str(argument) for argument in arguments)])


def test_why_it_was_named_and_what_would_have_turned_it(report: Path) -> None:
    for place in (report, report / "report.json"):
        done = why(place, NAMED)
        assert done.exit_code == 0
        assert "Joint coulomb friction at elbow is named: it passed all 4 tests." in done.output
        assert "gain would have to be below 17.9; it is 41.2" in done.output
        assert f"Its rivals\n  {RIVAL}: costs 9.2 more" in done.output


def test_why_its_rival_was_not(report: Path) -> None:
    done = why(report, RIVAL)
    assert "Joint stribeck friction at elbow is not named: costs 9.2 more." in done.output
    assert "its lead in the information criterion would have to be above 0; it is −9.2" in done.output
    assert f"What was chosen instead\n  {NAMED}: chosen" in done.output


def test_an_effect_that_was_left_aside_with_others_has_an_answer(report: Path) -> None:
    done = why(report, BOTH)
    said = (
        "Payload at link3 is not named: one of 2 further candidates that lower χ² by at most 7.5 each, to first order."
    )
    assert said in done.output
    assert "would have to be above 812; it is 7.5" in done.output


def test_without_an_effect_it_says_why_the_verdict(report: Path) -> None:
    said = why(report).output
    parts = ("Why\n", "Why not\n  Joint stribeck", "Why no further effect\n  nothing more promises", "What is left\n")
    assert [said.index(part) for part in parts] == sorted(said.index(part) for part in parts)
    assert "below 2.3 it would pass" in said


def test_the_same_as_json(report: Path) -> None:
    answer = json.loads(why(report, NAMED, "--json").output)
    assert (answer["schema"], answer["asked"], answer["named"]) == ("drake_cafim.why/1", NAMED, True)
    assert [item["step"] for item in answer["records"]] == ["admit", "choose", "adequacy"]
    whole = json.loads(why(report, "--json").output)
    assert [item["asked"] for item in whole["refused"]] == [RIVAL] and whole["no_more"]["threshold"] == 24.0


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("joint_coulomb_friction", "expected EFFECT@PLACE"),
        ("@elbow", "expected EFFECT@PLACE"),
        ("payload@link9", "payload was not looked for at link9"),
        ("payload@link9", "valid places: link2, link3"),
        ("pay_load@link3", "valid: payload"),
        ("sensor_drift@q.elbow", "no effect sensor_drift was looked for"),
    ],
)
def test_what_was_not_asked_about_is_one_sentence_with_valid_choices(report: Path, asked: str, said: str) -> None:
    done = why(report, asked)
    assert done.exit_code == 2
    assert said in done.output and len(done.output.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "it is no JSON"),
        ("[]", "its schema is not drake_cafim.report/1"),
        ('{"schema": "drake_cafim.run/1"}', "its schema is not drake_cafim.report/1"),
        ('{"schema": "drake_cafim.report/1", "explanation": []}', "it holds no `trace`"),
        ('{"schema": "drake_cafim.report/1", "explanation": [], "trace": [{"step": "admit"}]}', "is damaged"),
        ('{"schema": "drake_cafim.report/1", "explanation": [], "trace": ["admit"]}', "trace[0] is admit, expected"),
        ('{"schema": "drake_cafim.report/1", "trace": [{"step": "admit"}]}', "is damaged"),
    ],
)
def test_what_is_no_report_is_one_sentence(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "report.json").write_text(content)
    for place in (tmp_path, tmp_path / "report.json"):
        done = why(place, NAMED)
        assert done.exit_code == 2 and said in done.output and len(done.output.strip().splitlines()) == 1


def test_where_there_is_no_report_it_says_so(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "absent.json"):
        done = why(place, NAMED)
        assert done.exit_code == 2 and "it cannot be read (No such file or directory)" in done.output


def test_it_loads_nothing_that_is_slow(report: Path) -> None:
    code = "import sys; from drake_cafim.cli import main; main(sys.argv[1:], standalone_mode=False); "
    code += "print([name for name in ('pydrake', 'scipy', 'numba', 'matplotlib', 'numpy') if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code, "why", str(report), NAMED], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
