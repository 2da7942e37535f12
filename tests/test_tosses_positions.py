"""Throws of which positions alone were recorded: a ball's are diagnosed, a body whose rotation matters is refused."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose, estimate, examine
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.body import AerodynamicDrag
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.report.report_html import render
from tests.tosses import BALL, BLOCK, SCENARIO, thrown, thrown_scene

POSITION = SCENARIO.replace(", rotation: 2.0e-3", "")
FREE = "model: body.urdf\nchannels: {pose.body: {std: {position: 2.0e-4}}}\n"


def without(recordings: list[Recording], components: tuple[str, ...] = POSE_COMPONENTS[3:]) -> list[Recording]:
    """The recordings without these components of the pose."""
    gone = {f"pose.body.{component}" for component in components}
    return [
        Recording(run.name, run.time, {name: values for name, values in run.columns.items() if name not in gone})
        for run in recordings
    ]


def test_nothing_is_missing_of_a_ball_that_is_as_its_model_says(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, scenario=POSITION)
    recordings = thrown(scene.physics_at(np.array([3150.0, 0.31])), 3, count=2)
    verdict = diagnose(scene, [*without(recordings[:1]), recordings[1]])
    assert verdict.kind == "none", str(verdict)
    assert verdict.reduced_chi_square[0] == pytest.approx(1.0, abs=0.15)
    (stiffness, friction) = verdict.parameters
    assert stiffness.value == pytest.approx(3150.0, abs=4.0 * stiffness.std) and stiffness.std < 20.0
    assert friction.value == pytest.approx(0.31, abs=4.0 * friction.std)
    assert set(verdict.train.corrected.rmse) == set(verdict.noise) == {f"pose.body.{axis}" for axis in "xyz"}
    # −ln of three normal densities at their usual misfit, per sample
    expected = 3.0 * (np.log(2e-4) + 0.5 * np.log(2.0 * np.pi) + 0.5)
    assert verdict.train.corrected.nll == pytest.approx(expected, abs=1.0)
    assert any("only positions are used" in note for note in verdict.notes)


def test_thick_air_is_found_by_positions_alone(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, scenario=FREE)
    drag = AerodynamicDrag("body", {"coefficient": 0.1})
    recordings = without(thrown(scene.physics.with_effects([drag]), 2, count=2))
    recordings = [recording.window(0.0, 0.5) for recording in recordings]
    verdict, outcome = examine(scene, recordings[:1], held_out=recordings[1:])
    assert verdict.kind == "explained", str(verdict)
    (found,) = verdict.explanation
    assert found.effect.key == ("aerodynamic_drag", "body")
    assert found.values["coefficient"].value == pytest.approx(0.1, abs=4.0 * found.values["coefficient"].std)
    assert verdict.held_out is not None and verdict.held_out.corrected.nll < verdict.held_out.nominal.nll
    assert "turn about x" not in render(verdict, outcome, recordings[1:], ["cafim", "diagnose"])


def test_a_body_in_flight_needs_no_shape_and_unstated_noise_is_estimated(tmp_path: Path) -> None:
    """Nor is a load off its centre a hypothesis, which would make its rotation matter."""
    scene = thrown_scene(tmp_path, BLOCK, scenario="model: body.urdf\n")
    recordings = [recording.window(0.0, 0.4) for recording in without(thrown(scene.physics, 5, count=2))]
    found = estimate(scene, recordings)
    assert found.noise["pose.body.x"].std == pytest.approx(2e-4, rel=0.2) and not found.noise["pose.body.x"].stated
    names = {effect.name for effect in prepare(scene, recordings).problem().hypotheses()}
    assert "payload" not in names and {"gravity_misalignment", "aerodynamic_drag"} <= names


@pytest.mark.parametrize(
    ("shape", "com", "scenario", "reason"),
    [
        (BLOCK, "0 0 0", POSITION, "the collision shape of body is not a sphere"),
        (BALL, "0 0 0.01", POSITION, "the centre of mass can be 10 mm from the tracked origin"),
        ('<sphere radius="0.05"/>', "0 0 0", POSITION, r"moments of inertia differ by axis \(0.0003 to 0.0004 kg"),
        (
            BALL,
            "0 0 0",
            FREE + "unknown: [{parameter: com_x, body: body, mean: 0.0, std: 0.01}]\n",
            "the centre of mass can be 10 mm",
        ),
        (
            BALL,
            "0 0 0",
            FREE + "effects: [{effect: payload, at: body, mass: 0.1, x: 0.02, y: 0.0, z: 0.0}]\n",
            "the centre of mass can be 5 mm",
        ),
    ],
    ids=["box", "centre of mass", "inertia", "unknown", "load"],
)
def test_a_body_whose_rotation_matters_is_refused_with_what_is_missing(
    shape: str, com: str, scenario: str, reason: str, tmp_path: Path
) -> None:
    recordings = without(thrown(thrown_scene(tmp_path).physics, 5, count=1))
    scene = thrown_scene(tmp_path, shape, com, scenario)
    with pytest.raises(InputError, match=rf"pose\.body has no rotation \(columns qw, qx, qy, qz\).*{reason}"):
        diagnose(scene, recordings)


def test_half_a_quaternion_is_asked_for_the_other_half(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    with pytest.raises(InputError, match=r"there is no column pose\.body\.qy"):
        diagnose(scene, without(thrown(scene.physics, 5, count=1), ("qy", "qz")))
