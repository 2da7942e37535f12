"""Two effects at one joint, each of which hides the other: they are found together, or not at all."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import Looks
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.pairs_by_place import Pair, best_pairs
from drake_cafim.diagnosis.search.refused import Refused
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings import read
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.test_growth_by_place import search_with

GAIN, BIAS = 0.8, 0.4
"""The actuator's gain, and N m."""


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return search_with(tmp_path_factory.mktemp("arm"), lambda u, v: (u - BIAS) / GAIN)


def _at_first_joint(growth: GrowthByPlace, **effects: dict[str, float]) -> list[Effect]:
    joint = growth.problem.scene.tree.joint_names[0]
    return [effect_named(name)(joint, values) for name, values in effects.items()]


@pytest.mark.long
def test_both_are_found_with_their_strengths(growth: GrowthByPlace) -> None:
    first = growth.problem.scene.tree.joint_names[0]
    [pair, *others] = best_pairs(growth.problem, growth.best, growth.effects, growth.price, CONVERGED)
    assert not others, "nothing is missing at the second joint"
    found = {effect.key: effect for effect in pair.effects}
    assert set(found) == {("actuator_gain_error", first), ("actuator_bias", first)}
    gain, bias = (found[name, first] for name in ("actuator_gain_error", "actuator_bias"))
    assert gain.values["gain"] == pytest.approx(GAIN, rel=0.02)
    assert bias.values["torque"] == pytest.approx(BIAS, rel=0.05)


def test_they_take_the_place_of_what_stood_in_for_them(growth: GrowthByPlace) -> None:
    wrong = _at_first_joint(growth, joint_viscous_friction={"coefficient": 0.1})
    best = fit(growth.problem, growth.best.model.with_effects(wrong), tolerance=CONVERGED)
    [pair] = best_pairs(growth.problem, best, growth.effects, growth.price, CONVERGED)
    assert [effect.key for effect in pair.present] == [wrong[0].key]
    instead = pair.in_place(best.model)
    assert wrong[0].key not in instead.keys and len(instead.effects) == 2


def test_where_they_stand_no_others_are_looked_for(growth: GrowthByPlace) -> None:
    right = _at_first_joint(growth, actuator_gain_error={"gain": GAIN}, actuator_bias={"torque": BIAS})
    before = growth.problem, growth.best
    try:
        assert growth.settle(growth.best.model.with_effects(right))
        assert not growth.problem.forced_joints
        assert not list(best_pairs(growth.problem, growth.best, growth.effects, growth.price, CONVERGED))
    finally:
        growth.problem, growth.best = before


@pytest.mark.long
def test_the_growth_finds_them_where_either_alone_is_refused(growth: GrowthByPlace) -> None:
    joint = growth.problem.scene.tree.joint_names[0]
    before = growth.problem, growth.best
    try:
        growth.refused.add(growth.effects, growth.best.model)
        growth.grow()
        assert growth.best.model.keys == {("actuator_gain_error", joint), ("actuator_bias", joint)}
    finally:
        growth.problem, growth.best = before
        growth.refused = Refused()


def test_what_was_refused_is_tried_again_beside_other_effects_at_its_joint(growth: GrowthByPlace) -> None:
    second = growth.problem.scene.tree.joint_names[1]
    gain, bias = _at_first_joint(growth, actuator_gain_error={"gain": GAIN}, actuator_bias={"torque": BIAS})
    elsewhere = effect_named("actuator_bias")(second, {"torque": BIAS})
    before = growth.best
    try:
        growth.refused.add([bias, elsewhere], growth.best.model)
        holds = growth.refused.holds
        assert holds(bias, growth.best.model) and holds(elsewhere, growth.best.model)
        assert not holds(gain, growth.best.model)
        growth.best = fit(growth.problem, growth.best.model.with_effects([gain]), tolerance=CONVERGED)
        assert not holds(bias, growth.best.model)
        assert holds(elsewhere, growth.best.model), "nothing has changed at the second joint"
    finally:
        growth.best = before
        growth.refused = Refused()


NAMES = {"joint_viscous_friction": "coefficient", "joint_coulomb_friction": "torque"}


class _TwoLaws:
    """Rows of two laws at one joint whose columns nearly cancel: alone, each would have to drive the joint."""

    rows = 400
    forced_joints = ("shoulder",)

    def __init__(self, plausible: bool) -> None:
        rng = np.random.default_rng(3)
        first = rng.normal(size=self.rows)
        second = -0.9 * first + 0.4 * rng.normal(size=self.rows)
        sizes = (1.0, 3.0) if plausible else (-1.0, 3.0)
        self.residual = -(sizes[0] * first + sizes[1] * second) + 0.01 * rng.normal(size=self.rows)
        self.columns = {"joint_viscous_friction": first, "joint_coulomb_friction": second}
        self.laws = [effect_named(name)("shoulder", {NAMES[name]: 1.0}) for name in self.columns]

    def looks(self, at: Fit, law: Effect) -> Looks:
        def built(found: Array) -> Effect:
            return effect_named(law.name)(law.at, {NAMES[law.name]: float(found[0])})

        return Looks(iter([(self.columns[law.name][:, None], built)]))

    def pairs(self) -> list[Pair]:
        best = Fit(Model(np.zeros(0)), self.residual, np.zeros((self.rows, 0)), np.zeros((0, 0)), self.rows)
        return list(best_pairs(self, best, self.laws, lambda effect: 10.0, CONVERGED))  # type: ignore[arg-type]


def test_a_law_that_makes_no_sense_alone_may_stand_beside_another() -> None:
    problem = _TwoLaws(plausible=True)
    alone = problem.columns["joint_viscous_friction"]
    assert alone @ problem.residual > 0.0, "alone, the viscous friction that fits best drives the joint"
    [pair] = problem.pairs()
    assert [effect.values[NAMES[effect.name]] for effect in pair.effects] == pytest.approx([1.0, 3.0], rel=0.01)


def test_two_laws_of_which_one_makes_no_sense_are_none() -> None:
    assert not _TwoLaws(plausible=False).pairs()


@pytest.mark.long
def test_what_explains_as_much_alone_stays_alone(tmp_path: Path) -> None:
    """Beside forces that nobody knows viscous friction is found; no pair with it is worth a second effect."""
    rng = np.random.default_rng(4)
    growth = search_with(tmp_path, lambda u, v: u + 0.3 * v + rng.normal(0.0, 0.5, len(u)))
    [friction] = _at_first_joint(growth, joint_viscous_friction={"coefficient": 0.3})
    assert growth.settle(growth.best.model.with_effects([friction]))
    assert growth.problem.forced_joints == (friction.at,), "the noise of the effort remains"
    assert not list(best_pairs(growth.problem, growth.best, growth.effects, growth.price, CONVERGED))


def test_a_pair_is_tried_once(growth: GrowthByPlace) -> None:
    gain, bias = _at_first_joint(growth, actuator_gain_error={"gain": GAIN}, actuator_bias={"torque": BIAS})
    refused = Refused()
    assert refused.is_new(Pair((gain, bias), (), growth.best))
    assert not refused.is_new(Pair((bias, gain), (), growth.best))
    assert refused.is_new(Pair((gain, bias), tuple(_at_first_joint(growth, joint_viscous_friction={})), growth.best))


@pytest.mark.long
def test_a_stop_that_is_touched_in_one_recording_is_found_beside_a_tilt(tmp_path: Path) -> None:
    """In that recording the tilt alone makes the fit worse, and in the others the stop does nothing."""
    simulate("pair", "arm2", 5).write(tmp_path)
    found = diagnose(Scene.load(tmp_path / "scenario.yaml"), [read(path) for path in sorted(tmp_path.glob("train_*"))])
    assert found.kind == "explained"
    stop, tilt = sorted((item.effect for item in found.explanation), key=lambda effect: effect.name)
    assert stop.key == ("joint_hard_stop", "shoulder")
    # across the plane of the arm a turn of gravity is one of its first joint
    assert tilt.key in {("gravity_misalignment", "world"), ("sensor_bias", "q.shoulder")}
