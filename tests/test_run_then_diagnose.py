"""The main job from end to end: what was concealed in the world is named from its recordings, and nothing else."""

from pathlib import Path
from typing import Any

import pytest

from drake_cafim.commands.diagnose import diagnose_command
from drake_cafim.commands.run import RunRequest, run_command
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.experiment.closed_loop import Options


def run_and_diagnose(out: Path, concealed: tuple[Concealed, ...]) -> dict[str, Any]:
    request = RunRequest("hefting", "drake", Options(seed=1, experiments=1), concealed=concealed, diagnosed=False)
    run_command(request, out, lambda text: None)
    return diagnose_command("hefting", [str(out / "experiment_1.parquet")], (), out, lambda text: None)


@pytest.mark.ci
def test_concealed_friction_is_named(tmp_path: Path) -> None:
    friction = Concealed("joint_viscous_friction", "joint2", {"coefficient": 8.0})
    report = run_and_diagnose(tmp_path, (friction,))
    assert report["verdict"] == "explained"
    (found,) = report["explanation"]
    assert (found["effect"], found["at"]) == ("joint_viscous_friction", "joint2")
    assert found["parameters"]["coefficient"]["value"] == pytest.approx(8.0, rel=0.03)


@pytest.mark.ci
def test_nothing_is_found_where_nothing_was_concealed(tmp_path: Path) -> None:
    report = run_and_diagnose(tmp_path, ())
    assert report["verdict"] == "none"
    (mass,) = report["parameters"]
    assert mass["value"] == pytest.approx(0.05, abs=3.0 * mass["std"])
