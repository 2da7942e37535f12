"""A strength of which the recordings tell too little; a component that they do not show at all is no argument."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.posterior import NOTHING_KNOWN
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import determined
from drake_cafim.diagnosis.search.determined import descend, undetermined
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.friction import JointStribeckFriction
from drake_cafim.effects.link import Payload
from drake_cafim.effects.speed_limit import ActuatorSpeedLimit
from tests import two_links

PAYLOAD = Payload("link1", {"mass": 0.6, "x": 0.1, "y": 0.0, "z": -0.2})
UNSEEN = float(np.sqrt(NOTHING_KNOWN))


@pytest.mark.parametrize(
    ("std", "told"),
    [
        ([0.1, 0.1, 0.1, 0.1], None),
        # a load beside a horizontal axis may stand anywhere along it
        ([0.1, 0.1, UNSEEN, 0.1], None),
        ([0.21, 0.1, UNSEEN, 0.1], ("mass", 0.21)),
        ([0.1, 1.4, UNSEEN, 0.1], ("x", 1.4)),
        ([UNSEEN, UNSEEN, UNSEEN, UNSEEN], ("mass", UNSEEN)),
    ],
)
def test_what_is_not_determined_is_told_and_what_is_not_seen_is_not(
    std: list[float], told: tuple[str, float] | None
) -> None:
    found = undetermined(PAYLOAD, np.array(std), np.array(std))
    assert (None if found is None else found[:2]) == told


@pytest.mark.parametrize(
    ("law", "values", "std", "told"),
    [
        # the friction one way is known to be small beside that the other way
        ("joint_asymmetric_coulomb_friction", (0.3, 2.3), (0.2, 0.2), None),
        ("joint_asymmetric_coulomb_friction", (2.3, 0.3), (0.2, 0.2), None),
        ("joint_asymmetric_coulomb_friction", (0.3, 2.3), (0.2, 0.8), "torque_negative"),
        # a static torque that nothing shows makes the kinetic one no better known than itself
        ("joint_stribeck_friction", (0.3, 4.0, 0.05), (0.01, 5.0, 0.01), "static"),
        # a coefficient is no torque
        ("joint_load_dependent_friction", (0.3, 0.4), (0.2, 0.01), "torque"),
    ],
)
def test_a_strength_is_weighed_beside_the_largest_in_its_unit(
    law: str, values: tuple[float, ...], std: tuple[float, ...], told: str | None
) -> None:
    effect = effect_named(law)("shoulder").with_values(np.array(values))
    found = undetermined(effect, np.array(std), np.array(std))
    assert (None if found is None else found[0]) == told


def test_a_law_descends_to_the_simpler_one_where_a_strength_is_not_determined(tmp_path: Path) -> None:
    """Beside a force that nobody knows, a fast motion tells the Coulomb friction, and nothing of a static torque."""
    friction = 0.5
    read = two_links.recording("run", 1, friction=(friction, 0.0), noise=(2e-4, 2e-2, 0.2))
    prepared = prepare(
        two_links.scene(tmp_path, "channels: {q: {std: 2.0e-4}, v: {std: 2.0e-2}, u: {std: 0.2}}"), [read]
    )
    problem = prepared.problem()
    stribeck = JointStribeckFriction("shoulder", {"coulomb": friction, "static": friction, "velocity": 0.05})
    found = unbiased_fit(problem, problem.nominal().with_effects([stribeck]))
    simpler, [descent] = descend(problem, found, problem.hypotheses())
    assert descent.effect.name == "joint_stribeck_friction" and "static" in descent.reason
    [law] = simpler.model.effects
    assert descent.law is not None and law.key == descent.law.key == ("joint_coulomb_friction", "shoulder")
    assert law.values["torque"] == pytest.approx(friction, abs=0.03)
    # one that is determined stays
    assert descend(problem, simpler, problem.hypotheses()) == (simpler, [])


def test_a_law_each_of_whose_strengths_may_be_zero_is_not_named(tmp_path: Path) -> None:
    read = two_links.recording("run", 1, friction=(0.5, 2e-4), noise=(2e-4, 2e-3, 0.0))
    problem = prepare(two_links.scene(tmp_path), [read]).problem()
    laws = [
        effect_named("joint_asymmetric_coulomb_friction")(joint).with_values(np.ones(2)) for joint in two_links.JOINTS
    ]
    found = unbiased_fit(problem, problem.nominal().with_effects(laws))
    left, [descent] = descend(problem, found, [])
    assert descent.effect.at == "elbow" and descent.law is None
    assert descent.reason == "each of its strengths is within 3 standard deviations of its absence"
    assert [effect.at for effect in left.model.effects] == ["shoulder"]


def test_what_stands_beside_others_is_asked_again_without_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = prepare(two_links.scene(tmp_path), [two_links.recording("run", 1, friction=(0.5, 0.3))]).problem()
    laws = [effect_named("joint_coulomb_friction")(joint).with_values(np.ones(1)) for joint in two_links.JOINTS]
    found = unbiased_fit(problem, problem.nominal().with_effects(laws))

    def known_beside_the_elbow(problem: Problem, found: Fit, effect: Effect) -> str | None:
        return "alone" if effect.at == "elbow" or len(found.model.effects) == 1 else None

    monkeypatch.setattr(determined, "reason_against", known_beside_the_elbow)
    left, descents = descend(problem, found, [])
    assert [descent.effect.at for descent in descents] == ["elbow", "shoulder"]
    assert not left.model.effects


def test_a_limit_that_falls_with_a_speed_which_nothing_shows_is_a_constant_one(tmp_path: Path) -> None:
    channels = "channels: {q: {std: 2.0e-2}, v: {std: 2.0e-1}, u: {std: 0.0}}"
    read = two_links.recording("run", 6, duration=1.5, limit=4.0, noise=(2e-2, 0.2, 0.0))
    problem = prepare(two_links.scene(tmp_path, channels), [read]).problem()
    envelope = ActuatorSpeedLimit("shoulder", {"no_load_speed": 300.0, "stall_torque": 4.0})
    found = unbiased_fit(problem, problem.nominal().with_effects([envelope]))
    simpler, [descent] = descend(problem, found, problem.hypotheses())
    assert "no load speed" in descent.reason and "of its absence" in descent.reason
    [law] = simpler.model.effects
    assert law.key == ("actuator_saturation", "shoulder")
    assert law.values["limit"] == pytest.approx(4.0, abs=0.08)


@pytest.mark.parametrize(("stall", "plausible"), [(4.0, True), (0.3, False)])
def test_an_envelope_beyond_which_efforts_nearly_always_are_bounds_none(
    stall: float, plausible: bool, tmp_path: Path
) -> None:
    """What acts then is a force of velocity and sign, as friction is, and none of the effort that was recorded."""
    problem = prepare(two_links.scene(tmp_path), [two_links.recording("run", 1, duration=1.5)]).problem()
    envelope = ActuatorSpeedLimit("shoulder", {"no_load_speed": 30.0, "stall_torque": stall})
    assert problem.plausible(problem.nominal().with_effects([envelope])) == plausible
