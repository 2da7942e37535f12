"""Laws are put in the places of those that were found beside unknown forces, or share their probability."""

from collections.abc import Collection

import pytest

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.search import rivals_by_place
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from tests.test_growth_by_place import VISCOUS, arm_that_rubs, viscous


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def test_where_another_law_fails_the_one_that_it_would_replace_stays(growth: GrowthByPlace) -> None:
    """And what is left of the explanation is none that was asked for, however good its likelihood."""
    second = growth.problem.scene.tree.joint_names[1]
    friction, idle = (
        viscous(growth, 0.1),
        effect_named("joint_viscous_friction")(second, {"coefficient": 0.01}),
    )
    assert growth.settle(growth.best.model.with_effects([friction, idle])), "without what fails it is accepted"
    try:
        # at a place where nothing acts, a law and the one in its stead are as good as none
        growth.take(growth.best.model.with_effects([idle]))
        spring = effect_named("joint_spring")(second, {"stiffness": 0.01, "rest": 0.0})
        whole = growth.best
        assert not rivals_by_place._settle_with(growth, {idle.key: spring})
        assert growth.best is whole
    finally:
        growth.drop(growth.best.model.effects)


def test_a_better_law_is_put_in_place_though_another_effect_then_fails(growth: GrowthByPlace) -> None:
    second = growth.problem.scene.tree.joint_names[1]
    friction, idle = (
        viscous(growth, 0.1),
        effect_named("joint_viscous_friction")(second, {"coefficient": 0.01}),
    )
    spring = effect_named("joint_spring")(friction.at, {"stiffness": 0.01, "rest": 0.0})
    try:
        growth.take(growth.best.model.with_effects([spring, idle]))
        assert rivals_by_place._settle_with(growth, {spring.key: friction})
        assert growth.best.model.keys == {friction.key}
    finally:
        growth.drop(growth.best.model.effects)


def test_laws_that_do_not_fail_are_put_in_place_together(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    laws = {("old", f"j{k}"): effect_named("joint_viscous_friction")(f"j{k}", {"coefficient": 1.0}) for k in range(3)}
    fails = laws["old", "j1"].key
    asked: list[set[str]] = []

    def settle_with(growth: GrowthByPlace, better: dict[tuple[str, str], Effect]) -> bool:
        asked.append({key[1] for key in better})
        failing = {fails} & {law.key for law in better.values()}
        growth.failed |= failing
        return not failing

    monkeypatch.setattr(growth, "failed", set())
    monkeypatch.setattr(rivals_by_place, "_settle_with", settle_with)
    assert rivals_by_place._replace(growth, list(laws), laws, {})
    assert asked == [{"j0", "j1", "j2"}, {"j0", "j2"}]


def test_a_law_that_fails_once_all_is_fitted_shares_no_probability(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    friction = viscous(growth, 0.1)
    rival = effect_named("joint_spring")(friction.at, {"stiffness": 1.0})
    assert growth.settle(growth.best.model.with_effects([friction]))
    try:
        monkeypatch.setattr(rivals_by_place, "_contenders", lambda *given: ([(-3.0, growth.best, rival)], []))
        monkeypatch.setattr(growth, "settle", lambda model, needed: False)
        shared = rivals_by_place.compare_by_place(growth).probability[friction.key]
        assert shared == pytest.approx(0.5)

        def fails(model: Model, needed: Collection[Key]) -> bool:
            growth.failed.add(rival.key)
            return False

        monkeypatch.setattr(growth, "settle", fails)
        assert rivals_by_place.compare_by_place(growth).probability[friction.key] > 0.99
        # what is dropped since it fails a test has none, and so is no rival of what stands
        monkeypatch.setattr(
            rivals_by_place, "_drop_unsupported", lambda growth, _: growth.drop(growth.best.model.effects)
        )
        assert friction.key not in rivals_by_place.compare_by_place(growth).probability
    finally:
        monkeypatch.undo()
        growth.drop(growth.best.model.effects)


@pytest.mark.parametrize(("replaced", "expected"), [(True, 0.5), (False, 0.989)])
def test_what_a_law_cost_beside_others_is_forgotten_where_these_are_replaced(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch, replaced: bool, expected: float
) -> None:
    friction = viscous(growth, 0.1)
    rival = effect_named("joint_spring")(friction.at, {"stiffness": 1.0})
    assert growth.settle(growth.best.model.with_effects([friction]))

    def replace_all(
        own: GrowthByPlace, order: list[Key], better: dict[Key, Effect], tried: dict[tuple[Key, Key], float]
    ) -> bool:
        tried[friction.key, rival.key] = 9.0
        return replaced

    try:
        monkeypatch.setattr(rivals_by_place, "_contenders", lambda *given: ([(-3.0, growth.best, rival)], []))
        monkeypatch.setattr(rivals_by_place, "_replace", replace_all)
        shared = rivals_by_place.compare_by_place(growth).probability[friction.key]
        assert shared == pytest.approx(expected, abs=1e-3)
    finally:
        monkeypatch.undo()
        growth.drop(growth.best.model.effects)
