"""A report says which friction that the model file states is far too large."""

from pathlib import Path

import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.notes.stated_friction import stated_friction_notes
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.scene.scene import Scene
from tests import two_links


def _stating(folder: Path, dynamics: str) -> Scene:
    """The arm whose elbow has these `dynamics` in its file."""
    path = two_links.scenario(folder)
    model = folder / "two_links.urdf"
    text = model.read_text()
    elbow = text.index('<joint name="elbow"')
    end = text.index("</joint>", elbow)
    model.write_text(f"{text[:end]}<dynamics {dynamics}/>{text[end:]}")
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
    [note] = stated_friction_notes(problem, problem.nominal())
    assert note.startswith(f"elbow: two_links.urdf {said}of which the recordings show far less: ")


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_friction_that_is_as_stated_or_larger_is_not(tmp_path: Path, friction: float) -> None:
    scene = _stating(tmp_path, f'damping="0.0" friction="{friction}"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3)) for name, seed in (("a", 1), ("b", 2))]
    problem = prepare(scene, recordings).problem()
    assert not stated_friction_notes(problem, problem.nominal())


def test_the_verdict_has_the_note(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    found = diagnose(scene, [two_links.recording("a", 1)], settings=Settings(most_effects=0))
    assert found.kind == "unexplained"
    assert any(note.startswith("elbow: two_links.urdf states") for note in found.notes)
