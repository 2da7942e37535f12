"""The laws of friction of one joint, chosen among nested ones, on a two-joint arm that rubs in known ways."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.search import friction_by_joint, rivals_by_place
from drake_cafim.diagnosis.search.friction_by_joint import Friction
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import Compared, compare_by_place
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array
from tests.test_growth_by_place import arm_that_rubs

COULOMB, STATIC, SPEED, VISCOUS, WIDTH = 0.4, 0.7, 0.15, 0.3, 0.005
"""N m, N m, rad/s, N m s/rad, rad/s."""


def _coulomb(v: Array) -> Array:
    return COULOMB * np.tanh(v / WIDTH) + VISCOUS * v


def _stribeck(v: Array) -> Array:
    return _coulomb(v) + (STATIC - COULOMB) * np.exp(-((v / SPEED) ** 2)) * np.tanh(v / WIDTH)


def _kicked(v: Array) -> Array:
    """Coulomb and viscous friction, and at every fifth reversal ten times as much near rest: what nobody knows."""
    reversals = np.cumsum(np.diff(np.signbit(v), prepend=np.signbit(v[0])))
    kicked = (reversals % 5 == 1) * 10.0 * COULOMB * np.exp(-((v / 0.02) ** 2)) * np.tanh(v / WIDTH)
    return np.asarray(_coulomb(v) + kicked)


def _compared(folder: Path, friction: Callable[[Array], Array], *begin: str) -> tuple[GrowthByPlace, Compared]:
    """The comparison of an explanation whose effects at the first joint have the names `begin`, from any values."""
    growth = arm_that_rubs(folder, friction)
    joint = growth.problem.scene.tree.joint_names[0]
    start = {"coulomb": 0.3, "static": 0.9, "velocity": 0.05, "torque": 0.3, "coefficient": 0.2}
    effects = []
    for name in begin:
        law = effect_named(name)
        effects.append(law(joint, {strength.name: start[strength.name] for strength in law.strengths}))
    growth.take(growth.best.model.with_effects(effects))
    return growth, compare_by_place(growth)


def _named(growth: GrowthByPlace) -> dict[str, Effect]:
    return {effect.name: effect for effect in growth.best.model.effects}


@pytest.mark.long
def test_what_few_moments_tell_near_rest_is_no_stribeck_friction(tmp_path: Path) -> None:
    """A static torque that a few reversals show, each by another amount, is not determined by what they have alike."""
    growth, _ = _compared(tmp_path, _kicked, "joint_stribeck_friction", "joint_viscous_friction")
    named = _named(growth)
    assert set(named) == {"joint_coulomb_friction", "joint_viscous_friction"}
    assert named["joint_coulomb_friction"].values["torque"] == pytest.approx(COULOMB, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    "begin", [("joint_coulomb_friction",), ("joint_load_dependent_friction", "joint_viscous_friction")]
)
def test_laws_of_one_joint_are_changed_together(tmp_path: Path, begin: tuple[str, ...]) -> None:
    """Each of the laws alone would have to become the other kind before viscous friction shows beside it."""
    growth, compared = _compared(tmp_path, _stribeck, *begin)
    named = _named(growth)
    assert set(named) == {"joint_stribeck_friction", "joint_viscous_friction"}
    assert named["joint_stribeck_friction"].values["static"] == pytest.approx(STATIC, rel=0.05)
    assert named["joint_stribeck_friction"].values["coulomb"] == pytest.approx(COULOMB, rel=0.05)
    assert named["joint_viscous_friction"].values["coefficient"] == pytest.approx(VISCOUS, rel=0.05)
    for effect in growth.best.model.effects:
        assert compared.probability[effect.key] > 0.9


def test_sister_laws_share_no_probability(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where two laws of dry friction explain the same, that it is dry friction is as sure as ever."""
    growth = arm_that_rubs(tmp_path, _coulomb)
    joint = growth.problem.scene.tree.joint_names[0]
    coulomb = effect_named("joint_coulomb_friction")(joint, {"torque": COULOMB, "slip_velocity": WIDTH})
    viscous = effect_named("joint_viscous_friction")(joint, {"coefficient": VISCOUS})
    growth.take(growth.best.model.with_effects([coulomb, viscous]))
    sister = effect_named("joint_asymmetric_coulomb_friction")(joint)
    twice = friction_by_joint.choose_friction(growth)
    [option] = [option for option in twice[joint] if option.dry.key == coulomb.key and len(option.laws) == 2]
    alike = Friction(option.found, (sister, viscous))
    monkeypatch.setattr(rivals_by_place, "choose_friction", lambda growth: {joint: [option, alike]})
    compared = compare_by_place(growth)
    assert compared.probability[coulomb.key] > 0.9
    assert compared.probability[sister.key] == pytest.approx(0.5 * compared.probability[coulomb.key], rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("backward", [COULOMB, 1.5 * COULOMB])
def test_a_larger_law_stands_only_where_it_is_no_simpler_one(tmp_path: Path, backward: float) -> None:
    """Both torques of a symmetric friction are determined, and they do not differ."""

    def rubbed(v: Array) -> Array:
        return np.asarray(np.where(v > 0.0, COULOMB, backward) * np.tanh(v / WIDTH))

    growth = arm_that_rubs(tmp_path, rubbed)
    joint = growth.problem.scene.tree.joint_names[0]
    values = {"torque_positive": COULOMB, "torque_negative": backward, "slip_velocity": WIDTH}
    growth.take(growth.best.model.with_effects([effect_named("joint_asymmetric_coulomb_friction")(joint, values)]))
    option = Friction(growth.best, growth.best.model.effects)
    failure = friction_by_joint.failure_of(growth, option)
    assert (failure is None) == (backward != COULOMB)
    if failure is not None:
        assert "tells it from joint coulomb friction" in failure.words and not failure.passed
        assert failure.statistic is not None and failure.threshold is not None
        assert failure.statistic < failure.threshold


@pytest.mark.long
def test_the_trace_tells_which_laws_of_friction_stand_at_a_joint_and_why_others_do_not(tmp_path: Path) -> None:
    growth, _ = _compared(tmp_path, _stribeck, "joint_coulomb_friction")
    told = [record for record in growth.trace.records if "laws of friction that stand at" in record.words]
    chosen, *others = ({effect.partition("@")[0] for effect in record.asked.split(" + ")} for record in told)
    stribeck, coulomb, viscous = "joint_stribeck_friction", "joint_coulomb_friction", "joint_viscous_friction"
    assert chosen == {stribeck, viscous}
    assert all(other in others for other in ({coulomb, viscous}, {stribeck}, {coulomb}))
    assert [record.passed for record in told] == [True] + [False] * len(others)
    assert all(record.statistic is not None and record.statistic < 0.0 for record in told[1:])


def test_viscous_friction_beside_a_larger_law_is_named(tmp_path: Path) -> None:
    """It removes less than half of what is left at its joint; what the two remove together decides."""

    def rubbed(v: Array) -> Array:
        beating = 0.1 * np.sin(np.arange(len(v)) * 0.21 + 2.0 * np.sin(np.arange(len(v)) * 0.013))
        return np.asarray(COULOMB * 3.0 * np.tanh(v / WIDTH) + 0.2 * VISCOUS * v + beating)

    growth, _ = _compared(tmp_path, rubbed, "joint_coulomb_friction", "joint_viscous_friction")
    assert set(_named(growth)) == {"joint_coulomb_friction", "joint_viscous_friction"}
