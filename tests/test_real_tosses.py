"""Recordings of a real cube that was thrown: its friction is found again, and the held-out simulation improves."""

from pathlib import Path

import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.scene.scene import Scene


@pytest.mark.long
def test_thrown_cube_has_its_published_friction_and_lacks_more_than_is_known(data_folder: Path) -> None:
    """Published: a friction of 0.18 (Pfrommer, Halm, Posa, 2020); how the acrylic bounces is no effect of the list.

    By the set's README lengths are about 2 % short: the cube rests too low, and it falls with 9.62 m/s².
    """
    folder = data_folder / "data" / "cube_toss"
    tosses = [recordings.read(path) for path in sorted((folder / "runs").glob("*.parquet"))]
    verdict = diagnose(Scene.load(folder / "scenario.yaml"), tosses[:14], held_out=tosses[-5:])
    assert verdict.kind == "unexplained"
    friction = next(parameter for parameter in verdict.parameters if parameter.parameter == "friction")
    assert friction.value == pytest.approx(0.18, abs=0.02)
    [lengths] = [item.effect for item in verdict.explanation if item.effect.name == "sensor_gain_error"]
    assert lengths.values["gain"] == pytest.approx(0.98, abs=0.01)
    assert verdict.mismatch.locations[0].name == "cube/ground"
    assert verdict.held_out is not None
    nominal, corrected = verdict.held_out.nominal, verdict.held_out.corrected
    assert corrected.nll < nominal.nll
    for channel, error in corrected.rmse.items():
        assert error < nominal.rmse[channel]
