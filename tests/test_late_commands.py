"""A late command and a late position of one joint are the same motion."""

from pathlib import Path

import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import Compared, compare_by_place
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from tests.pan_servo import PERIOD, pan_recorded, pan_scene

LATE = 4
"""Samples."""
EFFECTS = {("command_delay", "pan"), ("sensor_delay", "q.pan")}


def _compared(tmp_path: Path, name: str, at: str) -> tuple[GrowthByPlace, Compared]:
    problem = prepare(pan_scene(tmp_path), [pan_recorded(seed, late=LATE) for seed in (1, 2)]).problem()
    assert isinstance(problem, WeakProblem)
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    growth.take(growth.best.model.with_effects([effect_named(name)(at, {"delay": LATE * PERIOD})]))
    return growth, compare_by_place(growth)


@pytest.mark.parametrize(("name", "at"), sorted(EFFECTS))
def test_a_delay_of_half_a_period_is_fitted_in_the_place_of_the_other(tmp_path: Path, name: str, at: str) -> None:
    """To first order, of a delay that long, it would explain next to nothing."""
    growth, compared = _compared(tmp_path, name, at)
    assert set(compared.probability) > EFFECTS
    asked = {f"{effect}@{place}" for effect, place in EFFECTS}
    leads = [record for record in growth.trace.records if record.test == "criterion"]
    assert all(abs(record.statistic or 0.0) < 100.0 for record in leads if record.asked in asked)
    assert all((record.statistic or 0.0) < -1000.0 for record in leads if record.asked not in asked)


def test_a_late_command_and_a_late_position_of_one_joint_are_as_probable(tmp_path: Path) -> None:
    _, compared = _compared(tmp_path, "command_delay", "pan")
    assert all(compared.probability[key] > 0.1 for key in EFFECTS)
