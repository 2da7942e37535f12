"""What a fit leaves without one of its effects, to first order, against fits without it."""

import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.posterior import NOTHING_KNOWN
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.without_effects import (
    fit_without,
    residual_left_by_others,
    residual_without,
    share_improved,
    share_removed,
    sum_by_part,
)
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.thresholds import UNKNOWN_REACH_IN_PRIOR_STDS
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint import JointViscousFriction
from tests.test_growth_by_place import VISCOUS, arm_that_rubs, fitted, viscous
from tests.test_left_out import recording, scene


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def test_rows_without_an_effect_are_those_of_a_fit_without_it(growth: GrowthByPlace) -> None:
    found, effect = fitted(growth)
    without = fit(growth.problem, found.model.without(effect))
    predicted = residual_without(found, effect)
    gained = without.chi_square - found.chi_square
    assert gained > 100.0
    assert float(predicted @ predicted) == pytest.approx(without.chi_square, abs=0.02 * gained)


def test_what_is_far_from_linear_is_worth_what_its_fit_loses(growth: GrowthByPlace) -> None:
    """A saturation beyond all but one effort: by its slope there, χ² would be two thousand times as large."""
    elbow = growth.problem.scene.tree.joint_names[1]
    saturation = effect_named("actuator_saturation")(elbow, {"limit": 1.2})
    found = fit(growth.problem, growth.best.model.with_effects([saturation, viscous(growth, VISCOUS)]))
    saturation, friction = found.model.effects
    for effect in (saturation, friction):
        exact, left = fit(growth.problem, found.model.without(effect)), found.residual
        rows, linear = residual_left_by_others(growth.problem, found, effect), residual_without(found, effect)
        assert float(rows @ rows) == pytest.approx(exact.chi_square, rel=1e-3)
        if effect is saturation:
            assert linear @ linear > 100.0 * exact.chi_square
            assert growth.wald(growth.problem, found, effect)[0] == float(rows @ rows - left @ left) < 10.0


def test_where_nothing_can_be_simulated_without_it_its_slope_tells(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, effect = fitted(growth)
    own = replace(growth.problem)
    impossible = np.full_like(found.residual, np.inf)
    monkeypatch.setattr(type(own), "residual", lambda self, model: impossible)
    np.testing.assert_array_equal(residual_left_by_others(own, found, effect), residual_without(found, effect))


def test_candidates_are_the_same_by_several_processes(growth: GrowthByPlace) -> None:
    effects = growth.nominal.hypotheses()[:40]
    alone, shared = (screen(growth.problem, growth.best, effects, jobs=jobs) for jobs in (1, 2))
    assert [(it.effect, it.gain, it.trials) for it in shared] == [(it.effect, it.gain, it.trials) for it in alone]
    assert len(alone) > 10


def test_a_fit_without_effects_is_theirs_to_first_order(growth: GrowthByPlace) -> None:
    joint = growth.problem.scene.tree.joint_names[1]
    spring = effect_named("joint_spring")(joint, {"stiffness": 0.5, "rest": 0.1})
    found = fit(growth.problem, growth.best.model.with_effects([spring, viscous(growth, VISCOUS)]))
    spring, friction = found.model.effects
    for gone, left in ((spring, friction), (friction, spring)):
        predicted, exact = fit_without(growth.problem, found, [gone]), fit(growth.problem, found.model.without(gone))
        assert [effect.key for effect in predicted.model.effects] == [left.key]
        np.testing.assert_array_less(np.abs(predicted.model.vector - exact.model.vector), 0.1 * exact.std + 1e-9)
        np.testing.assert_allclose(predicted.std, exact.std, rtol=0.02)
        assert predicted.chi_square == pytest.approx(exact.chi_square, rel=0.01)
    assert not fit_without(growth.problem, found, [spring, friction]).model.effects


def test_shares_compare_rows_with_and_without(growth: GrowthByPlace) -> None:
    found, effect = fitted(growth)
    without = residual_without(found, effect)
    assert share_removed(growth.problem, found.residual, without) > 0.5
    assert share_removed(growth.problem, found.residual, found.residual) == 0.0
    assert share_improved(growth.problem, found.residual, without) == 1.0
    assert share_improved(growth.problem, found.residual, found.residual) == 0.0


def test_a_strength_that_shows_nowhere_does_not_hide_the_others() -> None:
    """As how far along the vertical axes of a SCARA arm its load lies: the load is taken out all the same."""
    rng = np.random.default_rng(1)
    friction = effect_named("joint_viscous_friction")("elbow", {"coefficient": 0.3})
    load = effect_named("payload")("flange", {"mass": 1.0, "x": 0.05, "y": 0.02, "z": -0.1})
    jacobian = 100.0 * rng.standard_normal((60, 5)) * [1.0, 1.0, 1.0, 1.0, 0.0]
    covariance = np.zeros((5, 5))
    covariance[:4, :4] = np.linalg.inv(jacobian[:, :4].T @ jacobian[:, :4])
    left = []
    priors = SimpleNamespace(mean=np.zeros(0), clip=np.array)
    problem: Any = SimpleNamespace(
        scene=SimpleNamespace(unknown=(), priors=priors), prior_std=lambda model: np.zeros(0)
    )
    for variance in (1.0, NOTHING_KNOWN):
        covariance[4, 4] = variance
        found = Fit(
            Model(np.zeros(0), (friction, load)), rng.standard_normal(60) * 1e-6, jacobian, covariance.copy(), 60
        )
        left.append(residual_without(found, load))
        assert [effect.key for effect in fit_without(problem, found, [load]).model.effects] == [friction.key]
    assert np.linalg.norm(left[0]) > 100.0
    np.testing.assert_allclose(left[1], left[0], rtol=1e-3, atol=1e-3 * np.linalg.norm(left[0]))


def test_parts_that_do_not_show_an_effect_say_nothing_of_whether_it_helps() -> None:
    """A joint that sticks in three of four quarters: what friction changes there is a hundredth of the noise."""
    rng, quarter = np.random.default_rng(2), 100
    problem: Any = SimpleNamespace(
        rows=4 * quarter, runs=[SimpleNamespace(name="a", shape=(4 * quarter, 1))], apart=lambda rows: rows
    )
    residual = rng.standard_normal(4 * quarter)
    sticks = -0.01 * np.sign(residual) * np.abs(rng.standard_normal(4 * quarter))
    moves = np.where(np.arange(4 * quarter) // quarter == 2, 3.0 * rng.standard_normal(4 * quarter), 0.0)
    without = residual + np.where(moves == 0.0, sticks, moves)
    better = sum_by_part(problem, without, 4) > sum_by_part(problem, residual, 4)
    assert better.tolist() == [False, False, True, False]
    assert share_improved(problem, residual, without) == 1.0
    assert share_improved(problem, without, residual) == 0.0
    # where no part shows it, all count
    assert share_improved(problem, residual, residual + sticks) == 0.0


def test_others_adapt_within_their_bounds_alone(tmp_path: Path) -> None:
    """A mass twice as large as it is known to be: beyond its bound it would explain more than with the friction."""
    given = scene(tmp_path, "unknown: [{parameter: mass, body: block, mean: 2.0, std: 0.05}]\n")
    problem = prepare(given, [recording(f"run{k}", k, 4.0, 0.0, mass=4.0) for k in range(2)]).problem()
    found = fit(problem, Model(given.priors.mean, (JointViscousFriction("rail", {"coefficient": 1.0}),)))
    assert found.model.unknown[0] == pytest.approx(2.0 + 0.05 * UNKNOWN_REACH_IN_PRIOR_STDS)
    [friction] = found.model.effects
    without, left = residual_left_by_others(problem, found, friction), found.residual
    exact = fit(problem, found.model.without(friction))
    assert exact.chi_square > found.chi_square
    assert float(without @ without - left @ left) == pytest.approx(exact.chi_square - found.chi_square, rel=1e-3)


def test_what_is_left_without_an_effect_is_computed_once_for_each_problem(growth: GrowthByPlace) -> None:
    found, effect = fitted(growth)
    first = residual_left_by_others(growth.problem, found, effect)
    assert residual_left_by_others(growth.problem, found, effect) is first
    other = replace(growth.problem)
    again = residual_left_by_others(other, found, effect)
    assert again is not first
    np.testing.assert_array_equal(again, first)
    assert not pickle.loads(pickle.dumps(found)).left_without
