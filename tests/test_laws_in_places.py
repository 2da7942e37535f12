"""Laws that take the places of others: of two at once, or with a criterion that does not fall when they do."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.rivals import Lead
from drake_cafim.diagnosis.search import competition, rivals_by_place, search
from drake_cafim.diagnosis.search.pairs_by_place import pairs_in_place
from drake_cafim.diagnosis.search.refused import Refused
from drake_cafim.diagnosis.search.search_under_unknown_force import _grows_beside_others
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from tests.concealed.make import simulate
from tests.concealed_case import written


def _effect(name: str, at: str) -> Effect:
    return effect_named(name)(at)


GAIN_1, GAIN_2, GAIN_4 = (_effect("actuator_gain_error", joint) for joint in ("j1", "j2", "j4"))
ROTOR, LAG, DELAY, BIAS = (
    _effect(name, "j4") for name in ("rotor_inertia", "actuator_lag", "actuator_delay", "actuator_bias")
)


def _leads(**of: list[tuple[float, Effect]]) -> dict[Key, list[Lead]]:
    """What stands at j1 and j4, with the laws that were compared with it."""
    stands = {"j1": GAIN_1, "j4": GAIN_4}
    return {stands[at].key: [(lead, None, law) for lead, law in laws] for at, laws in of.items()}  # type: ignore[misc]


def test_two_laws_come_into_two_places_the_cheapest_first() -> None:
    found = _leads(j1=[(530.0, LAG), (113.0, GAIN_2)], j4=[(3713.0, GAIN_2), (97.0, ROTOR)])
    assert [sorted(law.key for law in pair.values()) for pair in pairs_in_place(found)] == [
        sorted([GAIN_2.key, ROTOR.key]),
        sorted([LAG.key, ROTOR.key]),
        sorted([LAG.key, GAIN_2.key]),
    ], "not one law in both places, nor two laws in one place"
    assert pairs_in_place(found)[0] == {GAIN_1.key: GAIN_2, GAIN_4.key: ROTOR}


def test_laws_that_exclude_each_other_are_no_pair() -> None:
    dry = [_effect(name, "j1") for name in ("joint_coulomb_friction", "joint_stribeck_friction")]
    assert dry[0].excludes(dry[1]) or dry[1].excludes(dry[0])
    assert pairs_in_place(_leads(j1=[(1.0, dry[0])], j4=[(1.0, dry[1])])) == []


@pytest.mark.parametrize(
    ("chi_square", "passes", "comes"), [(90.0, True, True), (90.0, False, False), (99.0, True, False)]
)
def test_a_pair_comes_where_it_fits_better(
    monkeypatch: pytest.MonkeyPatch, chi_square: float, passes: bool, comes: bool
) -> None:
    """By more than is worth a bare mention, and if it passes the tests; what fails in a pair has not failed alone."""
    settled: list[Any] = []

    def settle_with(own: Any, pair: dict[Key, Effect]) -> bool:
        settled.append(pair)
        own.failed |= set() if passes else {ROTOR.key}
        return passes

    best = SimpleNamespace(model=Model(np.zeros(0), (GAIN_1, GAIN_4)), cost=100.0)
    growth = SimpleNamespace(best=best, problem=None, trials=1, failed={GAIN_2.key})
    monkeypatch.setattr(rivals_by_place, "fit", lambda problem, model, tolerance: SimpleNamespace(cost=chi_square))
    monkeypatch.setattr(rivals_by_place, "criterion", lambda found, scale, trials: found.cost)
    monkeypatch.setattr(rivals_by_place, "_settle_with", settle_with)
    found = _leads(j1=[(113.0, GAIN_2)], j4=[(97.0, ROTOR)])
    assert rivals_by_place._replace_two(growth, found) is comes  # type: ignore[arg-type]
    assert settled == [{GAIN_1.key: GAIN_2, GAIN_4.key: ROTOR}] * (chi_square < 98.0)
    assert growth.failed == {GAIN_2.key}


def test_a_law_that_was_put_in_vain_has_the_criterion_that_it_had_there() -> None:
    """Under the noise of a lag a delay seems 3.4 better, and under its own it is worse by .07: the lag has its half."""
    leads = _leads(j4=[(-3.4, DELAY), (5.0, ROTOR)])[GAIN_4.key]
    tried = {(GAIN_4.key, DELAY.key): 0.07, (GAIN_4.key, ROTOR.key): 2.0, (LAG.key, ROTOR.key): 9.0}
    assert [lead for lead, _, _ in rivals_by_place._as_tried(GAIN_4.key, leads, tried)] == [0.07, 5.0]


@pytest.mark.parametrize(
    ("now", "asked", "refused"),
    [
        ((GAIN_1, LAG, BIAS), False, ()),
        ((GAIN_1, LAG), False, ()),
        ((GAIN_1,), True, ()),
        ((GAIN_1, LAG, ROTOR), True, (BIAS.key,)),
    ],
)
def test_of_two_that_are_gone_from_a_joint_each_may_stand_without_the_other(
    now: tuple[Effect, ...], asked: bool, refused: tuple[Key, ...]
) -> None:
    """As where another law has come; one that is gone alone was tried beside what is there."""
    grown, tried = Model(np.zeros(0), (GAIN_1, LAG, BIAS)), []
    growth = SimpleNamespace(best=SimpleNamespace(model=Model(np.zeros(0), now)), refused=Refused())
    growth.grow = lambda: tried.append(set(growth.refused.beside))
    assert not _grows_beside_others(growth, grown), "nothing stands out"  # type: ignore[arg-type]
    assert tried == ([set(refused)] if asked else [])


SENT_LATE, SENT_SLOW, SPRING = (_effect(name, "j1") for name in ("command_delay", "command_lag", "joint_spring"))


def _explanation(chi_square: float, *effects: Effect) -> Any:
    model = Model(np.zeros(0), effects)
    return SimpleNamespace(model=model, chi_square=chi_square, degrees_of_freedom=1000)


@pytest.mark.parametrize(
    ("chi_square", "evidence", "chosen"),
    [
        (1350.0, 1050.0, True),
        # "not worth more than a bare mention"
        (1350.0, 1149.0, False),
        # it leaves a tenth of what is explained
        (3000.0, 1050.0, False),
    ],
)
def test_laws_that_act_alike_are_compared_under_the_noise_of_each(
    monkeypatch: pytest.MonkeyPatch, chi_square: float, evidence: float, chosen: bool
) -> None:
    """Under the noise of a lag it leaves 1000, and the delay that is there 1350."""
    best, other = _explanation(1000.0, SENT_SLOW), _explanation(chi_square, SENT_LATE)
    asked = []

    def under_own_noise(state: Any, found: Any, scale: float) -> float:
        asked.append(found)
        return {id(best): 1150.0, id(other): evidence}.get(id(found), 0.0)

    monkeypatch.setattr(competition, "_evidence", under_own_noise)
    # not alike, at another joint, or with one more effect
    others = [_explanation(1350.0, *effects) for effects in ((SPRING,), (GAIN_2,), (SENT_LATE, GAIN_2))]
    fits = {found.model.keys: found for found in (best, other, *others)}
    state: Any = SimpleNamespace(
        problem=SimpleNamespace(whitened_by_model=True),
        pool=SimpleNamespace(fits=fits),
        rest=lambda model: _explanation(19_000.0),
        trace=Trace(),
    )
    assert competition.more_likely_alike(state, best) is (other if chosen else None)
    assert [record.passed for record in state.trace.records] == [chosen] * (chi_square < 2000.0)
    assert asked == ([best, other] if chi_square < 2000.0 else [])


@pytest.mark.parametrize("more_likely", [True, False])
def test_a_search_goes_on_under_the_noise_of_the_more_likely_law(
    monkeypatch: pytest.MonkeyPatch, more_likely: bool
) -> None:
    slow, late = _explanation(1000.0, SENT_SLOW), _explanation(1050.0, SENT_LATE)
    whitened: list[Any] = []
    state: Any = SimpleNamespace(
        problem=SimpleNamespace(has_other_noise=lambda model: False),
        pool=SimpleNamespace(fits={}),
        rewhiten=lambda found: whitened.append(found) or found,
    )
    monkeypatch.setattr(search, "compete", lambda state, best: best)
    monkeypatch.setattr(search, "grow", lambda state, best: best)
    monkeypatch.setattr(search, "more_likely_alike", lambda state, best: late if more_likely else None)
    assert search._explain(state, slow) is (late if more_likely else slow)
    assert whitened == [late] * more_likely, "once, and not back and forth"


@pytest.mark.parametrize("bounds", [True, False])
def test_what_bounds_an_effort_is_asked_along_the_effort_before(monkeypatch: pytest.MonkeyPatch, bounds: bool) -> None:
    law: Any = _effect("actuator_speed_limit", "j1")
    physics = SimpleNamespace(bounds_servo=lambda law: bounds)
    monkeypatch.setattr(Model, "physics", lambda self, scene: SimpleNamespace(model=self, **vars(physics)))
    before: Any = Model(np.zeros(0), (law, LAG)).physics_before(None, law)  # type: ignore[arg-type]
    assert (law in before.model.effects) is not bounds and LAG in before.model.effects


def test_laws_of_one_group_are_no_rivals_by_their_noise() -> None:
    dry = [_effect(name, "j1") for name in ("joint_coulomb_friction", "joint_stribeck_friction")]
    assert competition._alike_in_one_place(_explanation(1.0, dry[0]), _explanation(1.0, dry[1])) is None
    pair = competition._alike_in_one_place(_explanation(1.0, SENT_SLOW, GAIN_2), _explanation(1.0, SENT_LATE, GAIN_2))
    assert pair == (SENT_SLOW, SENT_LATE)


def test_the_criterion_of_a_law_that_was_put_in_vain_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    growth, tried = SimpleNamespace(failed=set(), settled_lead=0.07), dict[tuple[Key, Key], float]()
    monkeypatch.setattr(rivals_by_place, "_settle_with", lambda own, better: False)
    assert not rivals_by_place._replace(growth, [LAG.key], {LAG.key: DELAY}, tried)  # type: ignore[arg-type]
    assert tried == {(LAG.key, DELAY.key): 0.07}
    both = {LAG.key: DELAY, GAIN_1.key: GAIN_2}
    assert not rivals_by_place._replace(growth, list(both), both, tried)  # type: ignore[arg-type]
    assert tried == {(LAG.key, DELAY.key): 0.07, (GAIN_1.key, GAIN_2.key): 0.07}


@pytest.mark.long
@pytest.mark.parametrize(
    ("rig", "seed", "names"),
    [
        # a gain at two other joints and friction by direction stood for a gain, a rotor and friction
        (
            "arm4",
            0xDFD359D51920809403CE8F0E99AE7164,
            "actuator_gain_error@j2 joint_coulomb_friction@j3 joint_viscous_friction@j1 joint_viscous_friction@j4 "
            "rotor_inertia@j4 sensor_delay@v.j3",
        ),
        # neither a lag nor a delay had half of the probability, and without either what stands beside it failed
        (
            "arm4",
            0xEF6E24B3F9E16CE3FDC6F0F7885E9797,
            "actuator_lag|actuator_delay@j4 joint_coulomb_friction@j4 joint_viscous_friction@j1 rotor_inertia@j4 "
            "torque_ripple@j2",
        ),
        # a bias and a delay that was not there were dropped from a joint, and the bias not looked for again
        (
            "arm2",
            0xDDA312ADCD73FA27DFA58660D10EA77D,
            "actuator_bias@joint_1 actuator_bias@joint_2 joint_asymmetric_coulomb_friction@joint_1 "
            "joint_viscous_friction@joint_1 joint_viscous_friction@joint_2 sensor_lag|sensor_delay@v.joint_1 "
            "torque_ripple@joint_1 torque_ripple@joint_2",
        ),
    ],
)
def test_arms_that_lack_many_effects_are_told_all_that_is_clear(
    rig: str, seed: int, names: str, tmp_path: Path
) -> None:
    scene, recordings = written(simulate("many", rig, seed), tmp_path)
    told = {f"{item.effect.name}@{item.effect.at}" for item in diagnose(scene, recordings).explanation}
    for wanted in names.split():
        kinds, at = wanted.split("@")
        assert told & {f"{kind}@{at}" for kind in kinds.split("|")}, wanted
        told -= {f"{kind}@{at}" for kind in kinds.split("|")}
    assert not told
