"""When something is missing: a push is located to within its own length, before anything is named."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import Prepared, prepare
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate


@pytest.mark.parametrize("seed", [2, 6, 7, 9, 12])
def test_a_push_is_located_in_time(seed: int, tmp_path: Path) -> None:
    """Pushes that stand far above the noise, one of them at the very end."""
    case = simulate("single:external_disturbance", "arm3", seed)
    case.write(tmp_path)
    [effect] = case.truth["effects"]
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / effect["recording"])])
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    true = case.truth["nominal_parameters_true"]
    unknown = np.array([true[f"{one.parameter}.{one.at}"] for one in scene.unknown])
    locations = problem.locate(Model(unknown))
    begun, ended = effect["interval"]
    overlaps = [
        max(0.0, min(stop, ended) - max(start, begun)) / (max(stop, ended) - min(start, begun))
        for location in locations
        for start, stop in location.intervals
    ]
    assert max(overlaps) >= 0.7
