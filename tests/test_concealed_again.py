"""Kept cases diagnosed again: when seals are opened, what is scored, and the comparison with former scores."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.concealed import again, fake_diagnosis, prove, trial
from tests.concealed.case import RECORDINGS, Case
from tests.concealed.compare import changes, comparison
from tests.concealed.score import score
from tests.concealed.seal import Seal

NULL: dict[str, Any] = {"kind": "null", "rig": "arm2", "effects": [], "noise": {"kind": "white"}, "accept": []}
ODD = NULL | {
    "kind": "odd:odd_gusts",
    "effects": [{"effect": "odd_gusts", "at": "link3", "parameters": {}}],
    "strengths": [{"value": 10.0, "clear": True}],
}
NONE, EXPLAINED, UNEXPLAINED = range(3)
"""What the fake diagnosis says, by the length of the scenario."""


def report(verdict: str, *names: str) -> dict[str, Any]:
    named = [{"effect": name, "at": "link3", "parameters": {}} for name in names]
    return {"verdict": verdict, "explanation": named, "mismatch": {"locations": []}, "data_mistakes": [], "fit": {}}


def keep(out: Path, slot: int, truth: dict[str, Any], before: dict[str, Any] | None, now: int) -> str:
    """A case as a proof keeps it: told `before`, and told `now` by the fake diagnosis."""
    name, seal = f"case{slot}", Seal.close(truth)
    folder = out / "kept" / name
    (folder / name).mkdir(parents=True)
    text = "channels: {}\n"
    (folder / name / "scenario.yaml").write_text(text + "#" * ((now - len(text)) % 3))
    for file in RECORDINGS:
        (folder / name / file).write_bytes(b"")
    if before is not None:
        (folder / "report").mkdir()
        (folder / "report" / "report.json").write_text(json.dumps(before))
    (out / "opened").mkdir(exist_ok=True)
    with open(out / "seals.txt", "a") as stream:
        stream.write(f"{name} {seal.digest}\n")
    failure = "" if before is not None else "no report after 600 s"
    identity = {"slot": slot, "name": name, "case_kind": truth["kind"], "case_rig": "arm2", "seed": "0x1"}
    record = identity | {"digest": seal.digest, "salt": seal.salt, "opened": seal.truth, "failure": failure}
    record |= {"covered_unnamed": [], "diagnosed_seconds": 1.0}
    (out / "opened" / f"{slot:05d}.json").write_text(json.dumps(record))
    return name


@pytest.fixture
def proof(tmp_path: Path) -> Path:
    out = tmp_path / "proof"
    keep(out, 0, NULL, report("none"), NONE)
    keep(out, 1, NULL, report("unexplained"), NONE)
    keep(out, 2, ODD, report("unexplained"), EXPLAINED)
    keep(out, 3, ODD, report("unexplained", "payload"), UNEXPLAINED)
    keep(out, 4, NULL, None, NONE)
    return out


DIAGNOSE = ["--jobs", "1", "--diagnose", sys.executable, str(Path(fake_diagnosis.__file__))]


def test_kept_cases_are_diagnosed_again_and_compared(
    proof: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "again"
    assert prove.main(["--again", str(proof), "--out", str(out), *DIAGNOSE]) == 0
    scores = json.loads((out / "scores.json").read_text())
    figures = {line["name"]: line for line in scores["figures"]}
    alarms = figures["nulls: false alarms"]
    assert (alarms["before"], alarms["after"], alarms["count"]) == (pytest.approx(2.0 / 3.0), 0.0, 3)
    honest = figures["clear, outside the vocabulary: called unexplained"]
    assert (honest["before"], honest["after"]) == (0.5, 0.5)
    told = capsys.readouterr().out
    assert [line.split(":")[0].strip() for line in told.splitlines() if ": case" in line] == ["worse"] + 3 * ["better"]
    assert "case2 (slot 2" in next(line for line in told.splitlines() if "worse" in line)
    assert "no report after 600 s" in told
    page = (out / "comparison.html").read_text()
    assert "1 worse, 3 better, 0 otherwise" in page and "no blind proof" in page
    assert json.loads((out / "kept" / "case2" / "report" / "report.json").read_text())["verdict"] == "explained"


def test_a_truth_is_opened_after_its_verdict_is_written_and_its_seal_holds(
    proof: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "again"
    events: list[str] = []
    diagnosed, opened = again.diagnosed, again.opened_record

    def watch_diagnosis(diagnose: list[str], folder: Path, home: Path, limit: float) -> Any:
        assert sorted(path.name for path in home.iterdir()) == [folder.name]
        assert sorted(path.name for path in folder.iterdir()) == sorted(["scenario.yaml", *RECORDINGS])
        events.append(f"diagnosed {folder.name}")
        return diagnosed(diagnose, folder, home, limit)

    def watch_opening(source: Path, name: str) -> Any:
        assert (out / "kept" / name / again.VERDICT).exists()
        events.append(f"opened {name}")
        return opened(source, name)

    monkeypatch.setattr(again, "diagnosed", watch_diagnosis)
    monkeypatch.setattr(again, "opened_record", watch_opening)
    arguments = ["--again", str(proof), "--out", str(out), *DIAGNOSE]
    prove.main([*arguments[:4], "--cases", "case1", *arguments[4:]])
    assert events == ["diagnosed case1", "opened case1"]
    (out / "opened" / "00001.json").unlink()  # killed between the verdict and the score
    prove.main([*arguments, "--resume"])
    assert events.count("diagnosed case1") == 1 and events.count("opened case1") == 2
    assert sorted(set(events)) == sorted(f"{what} case{k}" for what in ("diagnosed", "opened") for k in range(5))
    before = len(events)
    prove.main([*arguments, "--resume"])
    assert len(events) == before
    with pytest.raises(SystemExit, match="not empty"):
        prove.main(arguments)
    with pytest.raises(SystemExit, match="another folder"):
        prove.main(["--again", str(proof), "--out", str(proof), "--overwrite", *DIAGNOSE])
    assert len(again.kept_cases(proof)) == 5
    path = proof / "opened" / "00002.json"
    path.write_text(path.read_text().replace("odd_gusts", "odd_other"))
    with pytest.raises(RuntimeError, match="case2: the truth is not the one that was sealed"):
        prove.main(["--again", str(proof), "--out", str(tmp_path / "other"), "--cases", "case2", *DIAGNOSE])


def test_what_a_proof_has_not_opened_yet_is_diagnosed_and_scored_later(proof: Path, tmp_path: Path) -> None:
    out, path = tmp_path / "again", proof / "opened" / "00003.json"
    record = path.read_text()
    path.unlink()
    (proof / "kept" / "case0" / "case0" / "held_1.parquet").unlink()  # half a copy
    prove.main(["--again", str(proof), "--out", str(out), *DIAGNOSE])
    slots = [item["slot"] for item in json.loads((out / "scores.json").read_text())["after"]]
    assert slots == [1, 2, 4] and (out / "kept" / "case3" / again.VERDICT).exists()
    path.write_text(record)
    prove.main(["--again", str(proof), "--out", str(out), "--resume", *DIAGNOSE])
    assert [item["slot"] for item in json.loads((out / "scores.json").read_text())["after"]] == [1, 2, 3, 4]


def test_changes_are_graded() -> None:
    effect = {"effect": "joint_spring", "at": "link3", "parameters": {"stiffness": [3.0, "N m/rad"]}}
    single = NULL | {"kind": "single:joint_spring", "effects": [effect], "strengths": [{"value": 9.0, "clear": True}]}
    outcomes = [
        (report("explained", "joint_spring"), 3),
        (report("unexplained"), 2),
        (report("none"), 1),
        (report("unexplained", "payload"), 0),
        (report("explained", "joint_spring", "payload"), 0),
        (None, 0),
    ]

    def item(told: dict[str, Any] | None) -> dict[str, Any]:
        return {"name": "a", "slot": 0, "opened": single} | score(single, told, "" if told else "exit 1")

    for old, low in outcomes:
        for new, high in outcomes:
            found = [change.kind for change in changes([item(old)], [item(new)])]
            wanted = ["better" if high > low else "worse" if high < low else "other"] if old is not new else []
            assert found == wanted
    line = comparison([item(outcomes[1][0])], [item(outcomes[0][0])])[0]
    assert (line.before, line.after) == (0.0, 1.0) and "0.000 → 1.000" in line.text()


def test_a_truth_that_changed_after_its_seal_stops_the_proof(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case("null", "arm2", {}, "arm2.urdf", "", {}, NULL)

    def forge(*_: object) -> tuple[None, str]:
        name = (tmp_path / "seals.txt").read_text().split()[0]
        (tmp_path / "seals.txt").write_text(f"{name} {Seal.close(NULL).digest}\n")
        return None, "exit 1"

    monkeypatch.setattr(trial, "make", lambda *_: case)
    monkeypatch.setattr(trial, "diagnosed", forge)
    (tmp_path / "opened").mkdir()
    with pytest.raises(RuntimeError, match="not the one that was sealed"):
        trial.attempt(trial.Trial(0, "null", "arm2", 1), [], tmp_path, 1.0, keep=True)
    assert not list((tmp_path / "opened").iterdir())
