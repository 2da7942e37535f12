"""A late command and a late position of one joint are the same, and share their evidence."""

from pathlib import Path

import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import compare_by_place
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from tests.pan_servo import PERIOD, pan_recorded, pan_scene

LATE = 4
"""Samples."""
EFFECTS = {("command_delay", "pan"), ("sensor_delay", "q.pan")}


@pytest.mark.parametrize(("name", "at"), sorted(EFFECTS))
def test_a_delay_of_half_a_period_has_the_other_one_as_rival(tmp_path: Path, name: str, at: str) -> None:
    problem = prepare(pan_scene(tmp_path), [pan_recorded(seed, late=LATE) for seed in (1, 2)]).problem()
    assert isinstance(problem, WeakProblem)
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    growth.take(growth.best.model.with_effects([effect_named(name)(at, {"delay": LATE * PERIOD})]))
    probability = compare_by_place(growth).probability
    assert all(probability.get(key, 0.0) > 0.1 for key in EFFECTS)
