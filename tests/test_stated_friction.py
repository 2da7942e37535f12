"""A report says which friction that the model file states is far too large."""

from dataclasses import replace
from pathlib import Path

import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.notes.stated_friction import overstated_friction
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.pan_servo import pan_recorded, pan_scene

SLOW = (("a", 3), ("b", 7))
"""Names and seeds of recordings that stay within the limits with little friction."""


def _stating(folder: Path, elbow: str, shoulder: str = "") -> Scene:
    """The arm whose joints have these dynamics in its file."""
    path = two_links.scenario(folder)
    model = folder / "two_links.urdf"
    text = model.read_text()
    for name, dynamics in (("elbow", elbow), ("shoulder", shoulder)):
        end = text.index("</joint>", text.index(f'<joint name="{name}"'))
        text = f"{text[:end]}<dynamics {dynamics}/>{text[end:]}"
    model.write_text(text)
    return Scene.load(path)


@pytest.mark.parametrize(
    ("dynamics", "said"),
    [
        ('damping="1.0"', "states a damping of 1 N m s/rad, "),
        ('friction="2.0"', "states a dry friction of 2 N m, "),
        ('damping="1.0" friction="1.0"', "states a damping of 1 N m s/rad and a dry friction of 1 N m, "),
    ],
)
def test_stated_friction_that_is_far_too_large_is_told(tmp_path: Path, dynamics: str, said: str) -> None:
    scene = _stating(tmp_path, dynamics)
    problem = prepare(scene, [two_links.recording("a", 1), two_links.recording("b", 2)]).problem()
    [(joint, note)] = overstated_friction(problem, problem.nominal()).items()
    assert joint == "elbow" and note.startswith(f"elbow: two_links.urdf {said}of which the recordings show far less: ")


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_friction_that_is_as_stated_or_larger_is_not(tmp_path: Path, friction: float) -> None:
    scene = _stating(tmp_path, f'damping="0.0" friction="{friction}"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3)) for name, seed in (("a", 1), ("b", 2))]
    problem = prepare(scene, recordings).problem()
    assert not overstated_friction(problem, problem.nominal())


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_friction_beside_a_far_larger_mistake_is_not(tmp_path: Path, share: float) -> None:
    """Of the efforts at the elbow 2 N m are none, so that friction is the least of what is wrong there."""
    scene = _stating(tmp_path, 'friction="0.3"')
    recordings = []
    for name, seed in SLOW:
        made = two_links.recording(name, seed, friction=(0.0, 0.3 * share))
        recordings.append(replace(made, columns={**made.columns, "u.elbow": made.columns["u.elbow"] + 2.0}))
    problem = prepare(scene, recordings).problem()
    assert not overstated_friction(problem, problem.nominal())


@pytest.mark.parametrize("share", [0.6, 0.4])
def test_far_less_is_less_than_half(tmp_path: Path, share: float) -> None:
    scene = _stating(tmp_path, 'friction="0.3"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3 * share)) for name, seed in SLOW]
    problem = prepare(scene, recordings).problem()
    assert len(overstated_friction(problem, problem.nominal())) == (share < 0.5)


def test_each_joint_has_its_own(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'friction="0.1"', 'friction="2.0"')
    problem = prepare(scene, [two_links.recording(name, seed, friction=(0.0, 0.1)) for name, seed in SLOW]).problem()
    [(joint, note)] = overstated_friction(problem, problem.nominal()).items()
    assert joint == "shoulder" and note.startswith("shoulder: two_links.urdf states a dry friction of 2 N m, ")


def test_of_a_servo_whose_efforts_nobody_recorded_nothing_is_told(tmp_path: Path) -> None:
    """What damps there may be the servo's."""
    pan_scene(tmp_path)
    model = tmp_path / "pan.urdf"
    model.write_text(model.read_text().replace('damping="0.6"', 'damping="2.0"'))
    problem = prepare(Scene.load(tmp_path / "pan.yaml"), [pan_recorded(1), pan_recorded(2)]).problem()
    assert not overstated_friction(problem, problem.nominal())


def test_the_verdict_has_the_note(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    found = diagnose(scene, [two_links.recording("a", 1)], settings=Settings(most_effects=0))
    assert found.kind == "unexplained"
    assert any(note.startswith("elbow: two_links.urdf states") for note in found.notes)
    assert "The model file states far more friction than the recordings show at elbow; see the notes." in str(found)
