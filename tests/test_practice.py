"""Cases with concealed effects, made by other simulators: named where they can be, never misnamed."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from drake_cafim import recordings
from drake_cafim.commands.why import in_words, why_command
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.numerics.rounding import THIN_SPACE
from drake_cafim.report.report_json import report_of
from drake_cafim.scene.scene import Scene
from tests.parametrize import long_after

QUICK = ["m4aftbrd", "tdj6cxun"]
SLOW = ["asssgs2p", "cb26z583", "f2fwzuw2", "getnt7g9", "pq2fvnwj", "qx2v2qqs", "sst22rux", "x6rqh3rw", "yht94gkq"]


TUTORIAL = Path(__file__).parents[1] / "diagrams" / "tutorials" / "why.md"


def _printed_in_tutorial(case: str) -> dict[str | None, list[str]]:
    """What the tutorial shows of this case: lines of `cafim why`, by the effect that was asked for.

    A line that it shows without a command answers to the effect named in the sentence before it.
    """
    text = TUTORIAL.read_text()
    section = next((part for part in text.split("\n## ") if f"`{case}`" in part), "")
    shown: dict[str | None, list[str]] = {}
    for before, block in re.findall(r"([^\n]*)\n+```\n(.*?)```", section, re.DOTALL):
        lines = block.splitlines()
        asked = re.search(r"cafim why out (\S+@\w+)", lines[0] if lines[0].startswith("$") else before)
        body = [line for line in lines if line and line != "..." and not line.startswith("$")]
        shown.setdefault(asked and asked[1], []).extend(body)
    return shown


def _check_tutorial(case: str, verdict: Verdict, folder: Path, out: Path) -> None:
    report = json.dumps(report_of(verdict, (), None, {}), ensure_ascii=False).replace(f"{folder}/", "")
    (out / "report.json").write_text(report)
    for asked, lines in _printed_in_tutorial(case).items():
        told = in_words(why_command(out, asked)).replace(THIN_SPACE, " ").splitlines()
        assert [line for line in lines if line not in told] == [], f"why.md is not what `cafim why out {asked}` prints"


def test_the_tutorial_shows_three_cases_with_an_answer_each() -> None:
    shown = {case: _printed_in_tutorial(case) for case in sorted(QUICK + SLOW)}
    assert {case for case, parts in shown.items() if parts} == {"f2fwzuw2", "tdj6cxun", "yht94gkq"}
    assert set(shown["f2fwzuw2"]) == {"joint_stribeck_friction@j4", "joint_coulomb_friction@j4"}
    assert [len(lines) for parts in shown.values() for lines in parts.values()] == [2, 1, 4, 6]


def _diagnosed(folder: Path) -> Verdict:
    scene = Scene.load(folder / "scenario.yaml")
    train = [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]
    return diagnose(scene, train, held_out=[recordings.read(folder / "held_1.parquet")])


@pytest.mark.parametrize("case", long_after(len(QUICK), [*QUICK, *SLOW]))
def test_practice_case(case: str, data_folder: Path, tmp_path: Path) -> None:
    folder = data_folder / "practice" / "cases" / case
    verdict = _diagnosed(folder)
    _check_tutorial(case, verdict, folder, tmp_path)
    # the truth is opened only now
    truth: dict[str, Any] = json.loads((data_folder / "practice" / "truth.json").read_text())["cases"][case]
    known = {effect.name for effect in EFFECTS}
    expected = truth["verdict"]
    if expected == "explained" and any(effect["effect"] not in known for effect in truth["effects"]):
        expected = "unexplained"
    assert verdict.kind == expected, str(verdict)
    if expected == "none":
        assert verdict.explanation == (), str(verdict)
    if expected != "explained":
        return
    named = sorted((accepted.effect.name, accepted.effect.at) for accepted in verdict.explanation)
    assert named == sorted((effect["effect"], effect["at"]) for effect in truth["effects"])
    for accepted in verdict.explanation:
        (effect,) = (e for e in truth["effects"] if e["effect"] == accepted.effect.name)
        for name, (value, _) in effect["parameters"].items():
            assert abs(accepted.values[name].value - value) < 5.0 * accepted.values[name].std + 1e-3 * abs(value), name
    assert verdict.held_out is not None
    assert verdict.held_out.corrected.nll < verdict.held_out.nominal.nll
