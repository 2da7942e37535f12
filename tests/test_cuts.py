"""`--cuts`: the recordings cut in other ways, and names that do not hold in three of four cuts told as unsure."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from drake_cafim import recordings
from drake_cafim.cli import main
from drake_cafim.commands import cuts as command
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.search import cuts
from drake_cafim.diagnosis.search.cuts import BLOCKS, DRAWS, cuts_of, named_in, with_cuts
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.test_unknown_effects import PENDULUM, swung

TIME = 0.01 * np.arange(801)


def _recordings(count: int) -> list[Recording]:
    return [Recording(f"run {k}", TIME, {"q.j": np.sin(TIME + k)}) for k in range(count)]


def test_each_recording_is_left_out_then_halves_then_blocks() -> None:
    three = _recordings(3)
    found = cuts_of(three, np.random.default_rng(0))
    assert [cut.words for cut in found[:5]] == ["without run 0", "without run 1", "without run 2", "first halves",
                                               "second halves"]  # fmt: skip
    assert [item.name for item in found[1].recordings] == ["run 0", "run 2"]
    first, second = found[3].recordings[0], found[4].recordings[0]
    assert first.time[-1] == second.time[0] == 4.0 and second.time[-1] == 8.0
    draws = found[5:]
    assert len(draws) == DRAWS and all(len(cut.recordings) == 3 * BLOCKS for cut in draws)
    assert all(item.duration == pytest.approx(1.0) for item in draws[0].recordings)
    assert len({item.name for item in draws[0].recordings}) == 3 * BLOCKS
    # with replacement: some twice, others not at all
    assert len({item.time[0] for item in draws[0].recordings}) < 3 * BLOCKS


def test_a_single_recording_has_no_cut_without_it_and_a_single_throw_none_at_all() -> None:
    assert not any(cut.words.startswith("without") for cut in cuts_of(_recordings(1), np.random.default_rng(0)))
    assert cuts_of(_recordings(1), np.random.default_rng(0), whole=True) == ()


def test_throws_are_cut_whole_and_many_are_left_out_in_groups() -> None:
    found = cuts_of(_recordings(20), np.random.default_rng(0), whole=True)
    assert all(item.duration == pytest.approx(8.0) for cut in found for item in cut.recordings)
    left_out = [20 - len(cut.recordings) for cut in found if cut.words.startswith("without")]
    assert len(left_out) == 8 and sum(left_out) == 20


def test_what_fewer_than_three_of_four_cuts_name_is_unsure(tmp_path: Path) -> None:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    channels = {"q": 2e-4, "v": 2e-3, "u": 0.0}
    scene = Scene.from_model(tmp_path / "pendulum.urdf", channels=channels, weld=["base"])
    verdict = diagnose(scene, [swung(friction=0.2)])
    [key] = named_in(verdict)
    other = ("payload", "rod")
    unsure = with_cuts(verdict, [frozenset({key}), frozenset(), frozenset({other}), frozenset({other})])
    assert unsure.explanation[0].cuts == 0.25
    assert "unsure: named in 1 of 4 cuts" in str(unsure)
    sure = with_cuts(verdict, [frozenset({key, other})] * 3 + [frozenset({other})], ["first halves: too short"])
    assert sure.explanation[0].cuts == 0.75 and "unsure" not in str(sure)
    assert any("payload at rod is named in 4 of 4 cuts" in note for note in sure.notes)
    assert any("first halves: too short" in note for note in sure.notes)


# diagnoses the recording and three cuts of it
def test_the_command_cuts_says_so_and_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuts, "DRAWS", 1)
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    channels = {"q": {"std": 2e-4}, "v": {"std": 2e-3}, "u": {"std": 0.0}}
    raw = {"model": "pendulum.urdf", "weld": [{"body": "base"}], "channels": channels}
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(raw))
    recordings.write(swung(friction=0.2), tmp_path / "run.parquet")
    out = tmp_path / "out"
    asked = ["diagnose", str(tmp_path / "scenario.yaml"), "--recording", str(tmp_path / "run.parquet"), "--cuts",
             "--no-replay", "--jobs", "1", "--out", str(out)]  # fmt: skip
    result = CliRunner().invoke(main, asked)
    assert result.exit_code == 0, result.output
    [named] = json.loads((out / "report.json").read_text())["explanation"]
    assert named["effect"] == "joint_viscous_friction" and named["cuts"] == 1.0
    assert "named in 100 % of the cuts" in (out / "report.html").read_text()
    # killed before the report: the cuts that are done are not diagnosed again
    (out / "diagnosis.json").unlink()
    monkeypatch.setattr(command, "_diagnosed", None)
    assert CliRunner().invoke(main, [*asked, "--resume"]).exit_code == 0
