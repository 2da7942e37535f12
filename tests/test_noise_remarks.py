"""Remarks on noise stand apart from mistakes of the data, for joints and for throws, and do not stop a search."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.noise.coloured import Memory, drawn
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.report_json import report_of
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.tosses import thrown, thrown_scene

MEMORY = Memory(0.012)


def _arm(folder: Path) -> tuple[Scene, list[Recording]]:
    runs, rng = [], np.random.default_rng(1)
    for seed in (1, 2):
        run = two_links.recording(f"run_{seed}", seed, noise=(2e-4, 0.0, 0.0), step=0.002)
        louder = {f"v.{joint}": run[f"v.{joint}"] + 2e-3 * drawn(rng, run.time, MEMORY) for joint in two_links.JOINTS}
        runs.append(replace(run, columns={**run.columns, **louder}))
    return two_links.scene(folder), runs


def _throw(folder: Path) -> tuple[Scene, list[Recording]]:
    scene, rng, runs = thrown_scene(folder), np.random.default_rng(1), []
    for run in thrown(scene.physics, 3, count=3, noise=(0.0, 2e-3)):
        louder = {f"pose.body.{k}": run[f"pose.body.{k}"] + 2e-4 * drawn(rng, run.time, MEMORY) for k in "xyz"}
        runs.append(replace(run, columns={**run.columns, **louder}))
    return scene, runs


@pytest.mark.parametrize("made", [_arm, _throw], ids=["arm", "throw"])
def test_noise_with_a_memory_is_a_remark_and_no_mistake(made: object, tmp_path: Path) -> None:
    assert callable(made)
    scene, runs = made(tmp_path)
    prepared = prepare(scene, runs)
    assert prepared.mistakes == ()
    (remark,) = prepared.noise_remarks
    assert remark.startswith(("the noise of v is not white", "the noise of the position of pose.body is not white"))


def test_the_report_has_it_under_noise_remarks(tmp_path: Path) -> None:
    scene, runs = _arm(tmp_path)
    report = report_of(diagnose(scene, runs, settings=Settings(most_effects=0)), (), None, {})
    assert report["data_mistakes"] == [] and len(report["noise_remarks"]) == 1
    assert "look wrong" not in report["sentence"]
    found = estimate(scene, runs)
    assert found.data_mistakes == () and len(found.noise_remarks) == 1
