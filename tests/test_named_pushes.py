"""A named push is located in time by its own interval, and has its share of the misfit that is explained."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.pushes import locate_named
from drake_cafim.diagnosis.verdict import Location, Verdict
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.tosses import thrown, thrown_scene

WORTH = {"a": 3.0, "b": 1.0, "elbow": 2.0}
"""Of χ², what the effect at each place takes off."""


class Told:
    """Rows that each of a model's effects takes down by what it is worth; the rest is always at `REST`."""

    def __init__(self) -> None:
        self.asked: list[Model] = []

    def locate(self, lacking: Model) -> tuple[Location, ...]:
        self.asked.append(lacking)
        return REST

    def rows_of(self, model: Model) -> Any:
        left = sum(WORTH.values()) - sum(WORTH[effect.at] for effect in model.effects)
        return np.array([np.sqrt(10.0 + left)])


def _push(at: str) -> ExternalDisturbance:
    return ExternalDisturbance(at, {"x": 1.0, "y": 0.0, "z": 0.0, "start": 1.0, "stop": 1.2}, f"{at}.csv")


FRICTION = JointViscousFriction("elbow", {"coefficient": 1.0})
REST = (
    Location("joint", "elbow", 0.7, ((0.0, 5.0),), "a.csv"),
    Location("joint", "wrist", 0.3, ((0.0, 5.0),), "a.csv"),
)


def test_pushes_have_their_part_of_what_is_explained() -> None:
    problem: Any = Told()
    best = Model(np.zeros(0), (_push("b"), FRICTION, _push("a")))
    found = locate_named(problem, best, Model(np.zeros(0)))
    assert [(location.kind, location.name, location.recording) for location in found] == [
        ("body", "a", "a.csv"),
        ("joint", "elbow", "a.csv"),
        ("body", "b", "b.csv"),
        ("joint", "wrist", "a.csv"),
    ]
    assert [location.share for location in found] == pytest.approx([3 / 6, 0.7 / 3, 1 / 6, 0.1])
    assert found[0].intervals == ((1.0, 1.2),)
    # the others are looked for beside the pushes
    assert [effect.at for effect in problem.asked[0].effects] == ["b", "a"]


def test_of_what_remains_a_named_push_has_no_share() -> None:
    best = Model(np.zeros(0), (_push("a"),))
    problem: Any = Told()
    found = locate_named(problem, best, best)
    assert found[:2] == REST and (found[2].name, found[2].share, found[2].intervals) == ("a", 0.0, ((1.0, 1.2),))
    assert locate_named(problem, Model(np.zeros(0), (FRICTION,)), Model(np.zeros(0))) == REST


@pytest.fixture
def pushes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but pushes is looked for, which is quick."""
    every = WeakProblem.hypotheses
    monkeypatch.setattr(
        WeakProblem,
        "hypotheses",
        lambda problem: tuple(effect for effect in every(problem) if isinstance(effect, ExternalDisturbance)),
    )


def _overlap(verdict: Verdict, at: str, recording: str, interval: tuple[float, float]) -> float:
    """Intersection over union of a push with what is told of its body in its recording."""
    assert [item.effect.key for item in verdict.explanation] == [("external_disturbance", at)]
    assert sum(item.share for item in verdict.mismatch.locations) <= 1.0 + 1e-9
    [(start, stop)] = [
        interval
        for item in verdict.mismatch.locations
        if (item.kind, item.name, item.recording) == ("body", at, recording)
        for interval in item.intervals
    ]
    return (min(stop, interval[1]) - max(start, interval[0])) / (max(stop, interval[1]) - min(start, interval[0]))


@pytest.mark.long
@pytest.mark.usefixtures("pushes_alone")
def test_a_push_on_an_arm_tells_when(tmp_path: Path) -> None:
    case = simulate("single:external_disturbance", "arm2", 3)
    case.write(tmp_path)
    [effect] = case.truth["effects"]
    recording = recordings.read(tmp_path / effect["recording"])
    verdict = diagnose(Scene.load(tmp_path / "scenario.yaml"), [recording])
    assert _overlap(verdict, effect["at"], recording.name, effect["interval"]) >= 0.7


def test_a_push_on_a_thrown_body_tells_when(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    values = {"x": 0.6, "y": -0.3, "z": 0.2, "start": 0.3, "stop": 0.42}
    push = ExternalDisturbance("body", values, "toss_0")
    prepared: Any = prepare(scene, thrown(scene.physics.with_effects([push]), 3, count=1))
    problem, bare = prepared.problem(), Model(scene.priors.mean)
    first, *others = locate_named(problem, bare.with_effects([push]), bare)
    assert (first.kind, first.name, first.recording, first.intervals) == ("body", "body", "toss_0", ((0.3, 0.42),))
    assert first.share == pytest.approx(1.0) and not others
