"""A diagnosis in parts that was killed goes on where it ended, and ends where one that was not does."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.commands import diagnose as command
from drake_cafim.commands.diagnose import FINISHED, KEPT, diagnose_command
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.long import fit_of_all
from drake_cafim.diagnosis.long import scan as looks
from drake_cafim.diagnosis.long.model_as_json import model_as_json, model_from_json
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.kept import Kept
from drake_cafim.recordings.long import in_parts
from drake_cafim.recordings.pieces import pieces_of
from drake_cafim.recordings.recording import Recording
from tests import two_links
from tests.test_long_recordings import prepared_parts


def counted(function: Callable[..., Any], calls: list[Any]) -> Callable[..., Any]:
    def counting(*arguments: Any) -> Any:
        calls.append(arguments)
        return function(*arguments)

    return counting


def test_a_model_is_kept_to_the_last_bit(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path)
    push = ExternalDisturbance("lower", {"x": 1.0 / 3.0, "z": -2.0, "start": 0.1, "stop": 0.7}, "log.parquet")
    drag = JointViscousFriction("elbow", {"coefficient": 0.1 + 0.2})
    model = Model(np.array([1.0 / 7.0]), (push, drag), (scene.unknown[0],), held=True)
    raw = model_as_json(model, scene)
    found = model_from_json(json.loads(json.dumps(raw)), scene)
    assert found.effects == model.effects and found.free == model.free and found.held
    assert np.array_equal(found.vector, model.vector)

    class Own(JointViscousFriction):
        name = "own"

    own: Effect = Own("elbow", {"coefficient": 1.0})
    assert model_as_json(Model(model.unknown, (own,)), scene) is None


def test_another_diagnosis_begins_anew_in_the_same_folder(tmp_path: Path) -> None:
    Kept.open(tmp_path / "parts", {"command": "a"}, resume=True).write("look_0", [1.0])
    for about, resume, found in (("a", True, [1.0]), ("b", True, None), ("b", False, None)):
        assert Kept.open(tmp_path / "parts", {"command": about}, resume).read("look_0", list) == found
    Kept.open(tmp_path / "parts", {"command": "b"}, resume=True).close()
    assert not (tmp_path / "parts").exists()


def test_what_was_kept_goes_where_the_command_was_killed_after_its_last_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished = {"command": ["cafim", "diagnose", "scenario.yaml", "--recording", "log.parquet"]}
    (tmp_path / FINISHED).write_text(json.dumps(finished))
    (tmp_path / "report.json").write_text("{}")
    Kept.open(tmp_path / KEPT, {}, resume=False).write("look_0", [1.0])
    monkeypatch.setattr(command, "read_report", lambda path, what: {"verdict": "none"})
    told = diagnose_command("scenario.yaml", ["log.parquet"], (), tmp_path, lambda text: None, resume=True)
    assert told == {"verdict": "none"} and not (tmp_path / KEPT).exists()


def test_looks_are_not_repeated_unless_they_are_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, prepared, _ = prepared_parts(tmp_path, 1)
    whole = two_links.recording("log", 4, duration=2.0, friction=(0.8, 0.3))
    columns = dict(whole.columns) | {"q.elbow": np.where(whole.time < 0.67, np.nan, whole["q.elbow"])}
    recordings.write(Recording("log", whole.time, columns), tmp_path / "log.parquet")
    parts, model = Parts.of([in_parts(pieces_of(tmp_path / "log.parquet"), 167)]), Model(scene.priors.mean)
    calls: list[Any] = []
    monkeypatch.setattr(looks, "_look", counted(looks._look, calls))
    kept = Kept.open(tmp_path / "parts", {}, resume=False)
    seen, notes = looks.scan(parts, prepared, model, kept=kept)
    (tmp_path / "parts" / "look_2.json").write_text('{"number": 2}')
    again, notes_again = looks.scan(parts, prepared, model, kept=kept)
    assert [arguments[3] for arguments in calls] == [0, 1, 2, 2]
    assert notes == notes_again and len(notes) == 1 and [part.number for part in again] == [1, 2]
    for before, after in zip(seen, again, strict=True):
        assert np.array_equal(before.excess, after.excess) and before.information == after.information
        assert (before.samples, before.p_value) == (after.samples, after.p_value)


def test_rows_of_a_pass_are_not_computed_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, prepared, parts = prepared_parts(tmp_path, 2)
    start = Model(scene.priors.mean, (JointViscousFriction("elbow", {"coefficient": 0.05}),))
    kept, calls = Kept.open(tmp_path / "parts", {}, resume=False), list[Any]()

    def lay_out(number: int, model: Model) -> WeakProblem:
        calls.append(number)
        return WeakProblem.of(scene, [prepared.laid_out(parts[number])], model)

    def fitted(count: int) -> np.ndarray:
        calls.clear()
        found = fit_of_all.fit_all(scene, lay_out, [start.keys] * count, start, keep=kept)
        return np.concatenate([found.fitted.model.vector, found.fitted.std, found.problem.runs[0].residual])

    monkeypatch.setattr(fit_of_all, "CHECKED", 0)
    first = fitted(2)
    computed = len(calls)
    assert np.array_equal(fitted(2), first) and not calls
    (tmp_path / "parts" / "rows_0_1.npz").write_bytes((tmp_path / "parts" / "rows_0_0.npz").read_bytes()[:-9])
    assert np.array_equal(fitted(2), first) and calls == [1] and computed >= 2
