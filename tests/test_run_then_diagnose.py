"""The main job from end to end: what was concealed in the world is named from its recordings, and nothing else."""

import json
from pathlib import Path
from typing import Any

import pytest

from drake_cafim.commands.diagnose import diagnose_command
from drake_cafim.commands.run import RunRequest, run_command
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.scene.scene import Scene


def run_and_diagnose(out: Path, concealed: tuple[Concealed, ...]) -> dict[str, Any]:
    request = RunRequest("hefting", "drake", Options(seed=1, experiments=1), concealed=concealed, diagnosed=False)
    run_command(request, out, lambda text: None)
    return diagnose_command("hefting", [str(out / "experiment_1.parquet")], (), out, lambda text: None)


@pytest.mark.long
def test_concealed_friction_is_named(tmp_path: Path) -> None:
    friction = Concealed("joint_viscous_friction", "joint2", {"coefficient": 8.0})
    report = run_and_diagnose(tmp_path, (friction,))
    assert report["verdict"] == "explained"
    (found,) = report["explanation"]
    assert (found["effect"], found["at"]) == ("joint_viscous_friction", "joint2")
    assert found["parameters"]["coefficient"]["value"] == pytest.approx(8.0, rel=0.03)


@pytest.mark.long
def test_nothing_is_found_where_nothing_was_concealed(tmp_path: Path) -> None:
    report = run_and_diagnose(tmp_path, ())
    assert report["verdict"] == "none"
    (mass,) = report["parameters"]
    assert mass["value"] == pytest.approx(0.05, abs=3.0 * mass["std"])


@pytest.mark.long
def test_a_run_says_that_its_ball_is_no_spring_and_damper(tmp_path: Path) -> None:
    """Drake's ball is a pressure field: with that law in its place the held-out recording is predicted far better."""
    request = RunRequest("pinching", "drake", Options(seed=1))
    record = run_command(request, tmp_path, lambda text: None)
    report = json.loads((tmp_path / record["diagnosis"]["report"]).read_text())
    [found] = report["explanation"]
    assert report["verdict"] == "explained"
    assert found["effect"] == "contact_law"
    assert found["at"] == "left_tip/ball"
    assert found["parameters"]["law"] == {"value": "hydroelastic", "std": None, "unit": "", "efficiency": None}
    # a ball of triangles gives way a little more than the sphere of the law
    assert found["parameters"]["modulus"]["value"] == pytest.approx(50930.0, rel=0.02)
    nominal, corrected = (report["fit"]["held_out"][name]["rmse"]["q.left_jaw"] for name in ("nominal", "corrected"))
    assert corrected < 0.2 * nominal
    # the corrected scenario names the law, and is read again
    scene = Scene.load(tmp_path / "diagnosis" / report["files"]["corrected_scenario"])
    assert [contact.law.normal for contact in scene.physics.contacts] == ["hydroelastic"]


@pytest.mark.long
def test_a_run_names_the_law_of_its_wall_with_drakes_numbers(tmp_path: Path) -> None:
    """The paper's wall is a spring with a resistance; Drake's tip is a pressure field of 2300 Pa that rubs with .4."""
    request = RunRequest("rubbing", "drake", Options(seed=1, experiments=2))
    record = run_command(request, tmp_path, lambda text: None)
    report = json.loads((tmp_path / record["diagnosis"]["report"]).read_text())
    found = {(each["effect"], each["at"]): each["parameters"] for each in report["explanation"]}
    law = found["contact_law", "tip/wall"]
    assert law["modulus"]["value"] == pytest.approx(2300.0, rel=0.01)
    assert law["dissipation"]["value"] == pytest.approx(0.5, rel=0.2)
    (friction,) = report["parameters"]
    assert friction["value"] == pytest.approx(0.4, rel=0.01)
