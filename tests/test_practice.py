"""Cases with concealed effects, made by other simulators: named where they can be, never misnamed."""

import json
from pathlib import Path
from typing import Any

import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.scene.scene import Scene

CASES = ["asssgs2p", "cb26z583", "f2fwzuw2", "getnt7g9", "m4aftbrd", "pq2fvnwj",
         "qx2v2qqs", "sst22rux", "tdj6cxun", "x6rqh3rw", "yht94gkq"]  # fmt: skip


def _diagnosed(folder: Path) -> Verdict:
    scene = Scene.load(folder / "scenario.yaml")
    train = [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]
    return diagnose(scene, train, held_out=[recordings.read(folder / "held_1.parquet")])


@pytest.mark.ci
@pytest.mark.parametrize("case", CASES)
def test_practice_case(case: str, data_folder: Path) -> None:
    verdict = _diagnosed(data_folder / "practice" / "cases" / case)
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
