"""Dry friction under a position servo is not taken for a dead band of it, which holds a joint about as well."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import compare_by_place
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import EFFECTS, effect_named
from drake_cafim.effects.joint import DRY_FRICTION
from tests.pan_servo import KP, pan_recorded, pan_scene

FRICTION = 0.3
"""N m"""
BAND = effect_named("servo_dead_band")("pan", {"width": FRICTION / KP})


@pytest.mark.long
def test_a_dead_band_gives_way_to_dry_friction(tmp_path: Path) -> None:
    growth = _growth(tmp_path)
    assert growth.settle(growth.best.model.with_effects([BAND]))
    _require_friction_alone(growth)
    # of all laws of dry friction the simplest one is tried in its place; which one it is, is chosen afterwards
    compared = {record.asked.partition("@")[0] for record in growth.trace.records if record.test == "criterion"}
    dry = {effect.name for effect in EFFECTS if effect.group == DRY_FRICTION}
    assert len(dry) > 1 and compared & dry == {"joint_coulomb_friction"}


def test_a_dead_band_found_first_does_not_outlive_dry_friction_found_beside_it(tmp_path: Path) -> None:
    growth = _growth(tmp_path)
    friction = effect_named("joint_coulomb_friction")("pan", {"torque": 0.1})
    # beside a band that holds the joint, friction explains little
    growth.take(growth.best.model.with_effects([BAND, friction]))
    _require_friction_alone(growth)


@pytest.mark.parametrize("slip_velocity", [1e-2, 1e-3, 1e-4])
def test_friction_of_any_width_predicts_each_sample(tmp_path: Path, slip_velocity: float) -> None:
    prepared = prepare(pan_scene(tmp_path), [pan_recorded(1, FRICTION)])
    physics = prepared.scene.physics
    friction = effect_named("joint_coulomb_friction")("pan", {"torque": FRICTION, "slip_velocity": slip_velocity})
    [without] = innovations(prepared.weak, physics)
    [found] = innovations(prepared.weak, physics.with_effects([friction]))
    assert found.lost is None and np.all(found.negative_log_likelihood < 10.0)
    assert found.mean < without.mean - 10.0


def _require_friction_alone(growth: GrowthByPlace) -> None:
    compare_by_place(growth)
    (found,) = growth.best.model.effects
    assert found.name == "joint_coulomb_friction"
    assert found.values["torque"] == pytest.approx(FRICTION, rel=0.01)


def _growth(tmp_path: Path) -> GrowthByPlace:
    problem = prepare(pan_scene(tmp_path), [pan_recorded(seed, FRICTION) for seed in (1, 2)]).problem()
    assert isinstance(problem, WeakProblem)
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    return growth
