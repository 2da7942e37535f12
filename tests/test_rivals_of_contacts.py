"""A raised surface and a biased position make the same touch: each is fitted in the place of the other."""

from pathlib import Path

import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import compare_by_place
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate


@pytest.mark.long
def test_a_raised_surface_is_fitted_in_the_place_of_a_biased_position(tmp_path: Path) -> None:
    case = simulate("single:surface_offset", "press", 5)
    case.write(tmp_path)
    [told] = case.truth["effects"]
    problem = prepare(Scene.load(tmp_path / "scenario.yaml"), [recordings.read(tmp_path / "train_1.parquet")]).problem()
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    bias = effect_named("sensor_bias")("q.pz", {"bias": told["parameters"]["offset"][0]})
    growth.take(growth.best.model.with_effects([bias]))
    probability = compare_by_place(growth).probability
    assert {("surface_offset", told["at"]), bias.key} <= probability.keys()
