"""Laws that are fitted in the place of another one, all other slopes kept, on a two-joint arm that rubs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.beside import Beside
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import joint_of
from drake_cafim.diagnosis.fit.rivals import FITTED_LEAD, prior_odds
from drake_cafim.diagnosis.joints import unknown_force
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.search import rivals_by_place
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.law_shapes import fit_shape_beside, fit_shapes
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.whitening.force_information import whitened_parts
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from tests.test_growth_by_place import arm_that_rubs

COULOMB, WIDTH = 0.4, 0.05


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    """Its explanation is viscous friction at both joints, where the first one has Coulomb friction."""
    growth = arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: COULOMB * np.tanh(v / WIDTH))
    laws = [_law(growth, joint, "joint_viscous_friction", coefficient=0.1) for joint in (0, 1)]
    growth.best = fit(growth.problem, growth.best.model.with_effects(laws))
    return growth


def _law(growth: GrowthByPlace, joint: int, name: str, **values: float) -> Effect:
    return effect_named(name)(growth.problem.scene.tree.joint_names[joint], values)


def _gained(growth: GrowthByPlace, law: Fit) -> float:
    return growth.best.chi_square - law.chi_square


def test_a_law_in_the_place_of_another_fits_as_where_all_slopes_are_computed_again(growth: GrowthByPlace) -> None:
    problem, best = growth.problem, growth.best
    viscous, other = best.model.effects
    coulomb = _law(growth, 0, "joint_coulomb_friction", torque=0.1, slip_velocity=0.5)
    start = best.model.without(viscous).with_effects([coulomb])
    beside = replace(Beside.of(problem, best, 0), position=1)
    kept, exact = beside.fit(start, 0.1), fit(problem, start, tolerance=0.1)
    assert _gained(growth, exact) > 100.0
    assert _gained(growth, kept) == pytest.approx(_gained(growth, exact), rel=0.01)
    assert [effect.key for effect in kept.model.effects] == [other.key, coulomb.key]
    for own, whole in zip(kept.model.effects, exact.model.effects, strict=True):
        np.testing.assert_allclose(own.vector, whole.vector, rtol=0.02)
    np.testing.assert_allclose(kept.std, exact.std, rtol=0.05)
    shaped, all_shaped = fit_shape_beside(beside, kept, 0.1), fit_shapes(problem, exact, {coulomb.key}, 0.1)
    assert _gained(growth, all_shaped) > 1.2 * _gained(growth, exact), "its width was wrong"
    assert _gained(growth, shaped) == pytest.approx(_gained(growth, all_shaped), rel=0.01)
    widths = [found.model.effects[-1].values["slip_velocity"] for found in (shaped, all_shaped)]
    assert widths[0] == pytest.approx(widths[1], rel=0.05) and widths[0] < WIDTH


def test_a_strength_ends_at_its_bound(growth: GrowthByPlace) -> None:
    """An effect that would drive where it is fitted freely ends at none, the other parameters adapting."""
    beside = Beside.of(growth.problem, growth.best, 1)
    start = growth.best.model.effects[1]
    assert start.values["coefficient"] < 0.05, "nothing rubs there"
    law = _law(growth, 1, "joint_load_dependent_friction", torque=0.1, coefficient=0.01)
    found = beside.fit(growth.best.model.without(start).with_effects([law]), 0.1)
    assert 0.0 <= found.model.effects[1].values["torque"] < 0.05
    assert 0.0 <= found.model.effects[1].values["coefficient"] < 0.05


def test_rivals_are_compared_without_another_jacobian(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    jacobian = WeakProblem.jacobian
    monkeypatch.setattr(WeakProblem, "jacobian", lambda *given: asked.append("jacobian"))
    moved: list[Model] = []
    under_own_noise: list[str] = []
    fitted = GrowthByPlace.lead_of

    def lead_of(own: GrowthByPlace, model: Model) -> float:
        under_own_noise.append(model.effects[-1].name)
        with monkeypatch.context() as undone:
            undone.setattr(WeakProblem, "jacobian", jacobian)
            return fitted(own, model)

    monkeypatch.setattr(GrowthByPlace, "lead_of", lead_of)
    looks = WeakProblem.looks
    monkeypatch.setattr(WeakProblem, "looks", lambda own, at, law: moved.append(at.model) or looks(own, at, law))
    leads, _ = rivals_by_place._contenders(growth, growth.best.model.effects[0])
    assert not asked
    assert under_own_noise == ["joint_coulomb_friction"], "of dry frictions one, and nothing else"
    assert moved and all(model is growth.best.model for model in moved), "laws act along one motion, which is cached"
    lead, other, law = leads[0]
    assert lead < 0.0 and law.name == "joint_coulomb_friction"
    assert law.values["torque"] == pytest.approx(COULOMB, rel=0.05)
    assert other.model.effects[-1] is law and not other.jacobian.size


def test_what_other_joints_lack_is_likely_here() -> None:
    delay, lag = effect_named("sensor_delay"), effect_named("sensor_lag")
    others = (delay("v.a", {"delay": 0.01}), delay("v.b", {"delay": 0.01}), delay("q.a", {"delay": 0.01}))
    here = lag("v.c", {"time_constant": 0.01})
    model = Model(np.zeros(0), (*others, here))
    assert prior_odds(model, here, delay("v.c", {"delay": 0.01})) == pytest.approx(2.5 / 0.5)
    assert prior_odds(model, here, delay("q.c", {"delay": 0.01})) == pytest.approx(1.5 / 0.5)
    assert prior_odds(model, here, effect_named("sensor_bias")("v.c", {"bias": 0.1})) == 1.0
    assert prior_odds(model, others[0], lag("v.a", {"time_constant": 0.01})) == pytest.approx(1.5 / 1.5)


def test_prior_odds_lower_a_laws_criterion(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    effect, leads = growth.best.model.effects[0], []
    for odds in (1.0, 4.0):
        monkeypatch.setattr(rivals_by_place, "prior_odds", lambda *given, odds=odds: odds)
        found, records = rivals_by_place._contenders(growth, effect)
        assert all(("prior odds of 4 : 1" in record.words) == (odds == 4.0) for record in records)
        leads.append({law.key: lead for lead, _, law in found})
    assert leads[0]
    assert leads[1] == pytest.approx({key: lead - 2.0 * np.log(4.0) for key, lead in leads[0].items()}, abs=1e-6)


def test_processes_find_the_same_rivals(growth: GrowthByPlace) -> None:
    found, told = [], []
    for jobs in (1, 2):
        own = replace(growth, settings=replace(growth.settings, jobs=jobs), trace=Trace())
        leads = rivals_by_place._all_contenders(own, {})
        found.append({key: [(lead, fitted.chi_square, law) for lead, fitted, law in of] for key, of in leads.items()})
        told.append(own.trace.records)
    assert found[0] == found[1] and told[0] == told[1] and told[0]


def test_the_density_of_forces_is_found_in_fewer_steps_from_near(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, model = [0], growth.best.model
    score = unknown_force._Whitened.score

    def counted(own: unknown_force._Whitened, change: unknown_force.Array) -> object:
        steps[0] += 1
        return score(own, change)

    monkeypatch.setattr(unknown_force._Whitened, "score", counted)
    far = growth.nominal.likeliest_force(model)
    many, steps[0] = steps[0], 0
    assert far is not None
    near = growth.nominal.likeliest_force(model, growth.nominal.with_unknown_force(far, model))
    assert near is not None
    assert steps[0] < many
    np.testing.assert_allclose(near, far, rtol=0.05)


def test_slopes_by_inertias_serve_delays_that_differ_little(tmp_path: Path) -> None:
    growth = arm_that_rubs(tmp_path, lambda v: 0.3 * v)
    problem = growth.problem
    assert isinstance(problem, WeakProblem)
    channel = f"v.{problem.scene.tree.joint_names[0]}"
    link = next(body for body in problem.scene.tree.bodies if body.joint == 0).name
    columns = {}
    for delay in (0.0080, 0.00801, 0.0085):
        late = effect_named("sensor_delay")(channel, {"delay": delay})
        physics = problem.nominal().with_effects([late]).physics(problem.scene)
        columns[delay] = problem._by_unknowns.inertials.of(physics, physics, link, np.zeros(10))
    np.testing.assert_array_equal(columns[0.0080], columns[0.00801])
    change = np.linalg.norm(columns[0.0085] - columns[0.0080]) / np.linalg.norm(columns[0.0080])
    assert 1e-6 < change < 0.1


def test_forces_that_are_felt_long_are_followed_to_the_end(growth: GrowthByPlace) -> None:
    """Without a force as noise, one at the first joint is felt in all later rows; beside one, in a few windows."""
    problem, model = growth.nominal, growth.best.model
    assert isinstance(problem, WeakProblem)
    physics = model.physics(problem.scene)
    for density in (1e-14, 1e-2):
        run = problem.with_unknown_force(np.full(2, density), model).runs[0]
        factor = unknown_force.unknown_force_factors(run.weak, physics)[0]
        by_parts = sum(float(np.sum(seen**2)) for _, seen in whitened_parts(run.whiten, factor))
        whole = run.whiten(factor.toarray())
        assert by_parts == pytest.approx(float(np.sum(whole**2)), rel=1e-6)


def test_rivals_stand_where_nothing_has_changed_at_their_joint(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the comparison after a law was replaced at the first joint, and of the one under less noise of the efforts."""
    own = replace(growth)
    asked: list[Key] = []
    contenders = rivals_by_place._contenders
    monkeypatch.setattr(
        rivals_by_place, "_contenders", lambda given, effect: asked.append(effect.key) or contenders(given, effect)
    )
    first, second = (effect.key for effect in own.best.model.effects)
    compared = rivals_by_place.compare_by_place(own)
    names = [effect.name for effect in own.best.model.effects if joint_of(effect) == first[1]]
    assert "joint_coulomb_friction" in names, "the law that is there has taken the place of the other one"
    assert asked.count(second) == 1, "nothing has changed at the second joint"
    assert asked[:2] == [first, second] and len(asked) > 2, "its new law is compared with others, too"
    rivals = compared.rivals
    assert rivals is not None
    kept = rivals.at(own.best, whitened=True)
    assert kept, "no strength has moved, and none has a rival"
    for key, leads in kept.items():
        for lead, other, law in leads:
            assert lead > FITTED_LEAD
            assert other.model.keys == own.best.model.keys - {key} | {law.key}
    key, [(lead, other, law), *others] = next((key, leads) for key, leads in kept.items() if leads)
    alike = replace(other, penalty=other.penalty - other.chi_square + own.best.chi_square + 1.0)
    near = replace(rivals, found={**rivals.found, key: [(lead, alike, law), *others]})
    assert key not in near.at(own.best, whitened=True), "by its χ² it is a rival"
    assert key in near.at(own.best, whitened=False)
    effect = next(effect for effect in own.best.model.effects if effect.key in kept)
    std = own.best.std[len(own.best.model.unknown) :].max()
    moved = effect.with_values(effect.vector + 10.0 * std)
    present = [moved if it is effect else it for it in own.best.model.effects]
    elsewhere = replace(own.best, model=replace(own.best.model, effects=tuple(present)))
    assert effect.key not in rivals.at(elsewhere, whitened=True)
    assert effect.key in rivals.at(elsewhere, whitened=False), "the same noise, and no other law"
