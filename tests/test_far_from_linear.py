"""What is far from linear is no reason to turn away others: tests after fits to first order that do not hold."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from drake_cafim.diagnosis.fit import fitting
from drake_cafim.diagnosis.fit.fitting import Fit, fit, fit_at_first_order, fit_beside
from drake_cafim.diagnosis.fit.model import Model, step_from, weakened
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.without_effects import fit_without
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.left_out.parts import parts_of
from drake_cafim.diagnosis.left_out.refits import UNKNOWNS, Refits
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import rivals_by_place
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.inertials import stepped, with_change
from drake_cafim.scenario.unknown import inertials
from tests.concealed.make import simulate
from tests.concealed_case import written
from tests.test_growth_by_place import VISCOUS, arm_that_rubs, viscous


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def _saturation(growth: GrowthByPlace) -> Effect:
    """One beyond all but one effort: by its slope there, χ² would be a hundred times as large without it."""
    return effect_named("actuator_saturation")(growth.problem.scene.tree.joint_names[1], {"limit": 1.2})


def test_friction_stands_where_a_saturation_that_is_dropped_is_far_from_linear(growth: GrowthByPlace) -> None:
    found = fit(growth.problem, growth.best.model.with_effects([_saturation(growth), viscous(growth, VISCOUS)]))
    saturation, friction = found.model.effects
    nearly = fit_without(growth.problem, found, [saturation])
    assert growth.wald(growth.problem, nearly, nearly.model.effects[0])[0] < 0.0, "there the friction seems to fail"
    kept = growth._without_failing(growth.problem, found)
    assert kept.model.keys == {friction.key}
    assert kept.chi_square == pytest.approx(fit(growth.problem, kept.model).chi_square, abs=0.1)


def test_additions_that_fit_worse_than_none_to_first_order_are_left_to_a_fit(growth: GrowthByPlace) -> None:
    far = [effect_named("actuator_delay")(growth.problem.scene.tree.joint_names[1], {"delay": 0.15})]
    joint = [viscous(growth, VISCOUS)]
    assert growth._that_may_stand(growth.best, joint) == joint
    assert growth._that_may_stand(growth.best, far) == far


def test_a_fit_that_ends_worse_than_without_its_effects_begins_again_with_little_of_them(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[Model] = []

    def recorded(problem: Problem, model: Model, *, badly: bool, **options: object) -> Fit:
        begun.append(model)
        found = fit(problem, model)
        return replace(found, residual=100.0 * found.residual) if badly and len(begun) == 1 else found

    model = growth.best.model.with_effects([viscous(growth, VISCOUS)])
    monkeypatch.setattr(fitting, "fit", partial(recorded, badly=True))
    found = fit_beside(growth.problem, growth.best, model)
    assert [each.effects[0].values["coefficient"] for each in begun] == pytest.approx([VISCOUS, 0.1 * VISCOUS])
    assert found.chi_square < growth.best.chi_square
    begun.clear()
    monkeypatch.setattr(fitting, "fit", partial(recorded, badly=False))
    fit_beside(growth.problem, replace(growth.best, penalty=-1e6), model)
    assert len(begun) == 1, "fits are compared by their rows, not by what else they pay for"


def test_a_weakened_effect_is_nearer_to_none_and_the_others_are_as_they_were() -> None:
    gain, friction = (
        effect_named(name)("elbow", values)
        for name, values in (("actuator_gain_error", {"gain": 0.5}), ("joint_viscous_friction", {"coefficient": 2.0}))
    )
    model = Model(np.array([3.0]), (gain, friction))
    weak = weakened(model, {gain.key}, 0.1)
    assert [dict(effect.values) for effect in weak.effects] == [{"gain": pytest.approx(0.95)}, {"coefficient": 2.0}]
    np.testing.assert_array_equal(weak.unknown, model.unknown)


@pytest.fixture(scope="module")
def with_inertials(tmp_path_factory: pytest.TempPathFactory) -> WeakProblem:
    """An arm of two joints with all inertials unknown."""
    scene, read = written(simulate("null", "arm2", 12), tmp_path_factory.mktemp("arm"))
    problem = prepare(replace(scene, scenario=replace(scene.scenario, unknown=[])).with_uncertain_inertials(0.2), read)
    found = problem.problem()
    assert isinstance(found, WeakProblem)
    return found


def test_rows_change_as_their_slopes_tell_along_a_step_of_inertials(with_inertials: WeakProblem) -> None:
    problem, nominal = with_inertials, with_inertials.nominal()
    model = replace(nominal, unknown=nominal.unknown + 0.5 * problem.scene.priors.std)
    step = problem.scene.priors.std * np.sign(np.sin(np.arange(len(model.unknown))))
    rows, told = problem.rows_of(model), problem.jacobian(model)[: problem.rows] @ step
    off = [
        float(np.linalg.norm(problem.rows_of(reached) - rows - told) / np.linalg.norm(told))
        for reached in (step_from(problem.scene, model, step), model.at(model.vector + step))
    ]
    assert off[0] < 1e-12 and off[1] > 0.1


def test_a_fit_of_inertials_that_are_far_off_takes_few_steps(
    with_inertials: WeakProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = with_inertials
    exact = fit(problem, problem.nominal())
    far = replace(exact.model, unknown=exact.model.unknown - 2.0 * problem.scene.priors.std)
    assert fit(problem, far, iterations=4).chi_square == pytest.approx(exact.chi_square, abs=1.0)
    monkeypatch.setattr(fitting, "step_from", lambda scene, model, step: model.at(model.vector + step))
    assert fit(problem, far, iterations=4).chi_square > exact.chi_square + 1000.0


def test_a_step_to_where_no_body_has_such_inertials_is_one_of_their_parameters(with_inertials: WeakProblem) -> None:
    scene = with_inertials.scene
    link = next(iter(inertials(scene.unknown)))
    body, theta = scene.tree.body(link), np.zeros(10)
    far = np.array([-2.0, *np.zeros(9)])
    np.testing.assert_array_equal(stepped(body, theta, far), far)
    near = 0.1 * far
    moved = with_change(body, stepped(body, theta, near))
    assert moved.mass == pytest.approx(body.mass * (1.0 + 2.0 * near[0]))


def test_an_effect_stands_for_which_unknowns_would_have_to_be_far_from_their_priors(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = fit(growth.problem, growth.best.model.with_effects([viscous(growth, VISCOUS)]))
    [effect] = best.model.effects
    own = replace(growth, best=best)
    rows, priors = best.residual[: own.problem.rows], best.residual[own.problem.rows :]
    least = own.threshold(1)
    for rise, stands in ((0.5 * least, False), (2.0 * least, True)):
        far = np.append(rows, np.sqrt((priors @ priors + rise) / len(priors)) * np.ones(len(priors)))
        monkeypatch.setattr(rivals_by_place, "residual_left_by_others", lambda *_, far=far: far)
        assert (rivals_by_place._share(own, [effect]) > NAMED_EXCESS_SHARE) == stands


def test_an_effect_stands_where_noise_is_all_that_is_left_beside_it(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = fit(growth.problem, growth.best.model.with_effects([viscous(growth, VISCOUS)]))
    rows, own = best.residual[: growth.problem.rows], replace(growth, best=best)
    # by a share of .17 of all squares, most of which are noise
    without = np.append(1.1 * rows, best.residual[growth.problem.rows :])
    monkeypatch.setattr(rivals_by_place, "residual_left_by_others", lambda *_: without)
    assert rivals_by_place._share(own, [best.model.effects[0]]) > NAMED_EXCESS_SHARE


def _far(problem: WeakProblem) -> tuple[Fit, Effect]:
    """A rotor that is not there, beside links as heavy as they are: without it these have to change by much."""
    joint = problem.scene.tree.joint_names[0]
    model = problem.nominal().with_effects([effect_named("rotor_inertia")(joint, {"inertia": 0.005})])
    whole = fit(problem, model)
    rows, slopes = problem.residual(model), problem.jacobian(model)
    return replace(whole, model=model, residual=rows, jacobian=slopes), model.effects[0]


def test_what_is_left_without_an_effect_to_first_order_is_left_by_its_inertials(with_inertials: WeakProblem) -> None:
    problem, (found, rotor) = with_inertials, _far(with_inertials)
    nearly = fit_without(problem, found, [rotor])
    assert np.max(np.abs(nearly.model.unknown) / problem.scene.priors.std) > 0.5
    np.testing.assert_allclose(problem.rows_of(nearly.model), nearly.residual[: problem.rows], atol=1e-6)


def test_one_step_with_a_further_effect_leaves_what_it_says(with_inertials: WeakProblem) -> None:
    problem, (found, rotor) = with_inertials, _far(with_inertials)
    bare = fit_without(problem, found, [rotor])
    first = fit_at_first_order(problem, bare, found.model, [problem.effect_columns(found.model, 0)])
    off = problem.rows_of(first.model) - first.residual[: problem.rows]
    assert np.linalg.norm(off) < 1e-3 * np.linalg.norm(found.residual)


def test_refits_without_a_part_predict_its_rows_by_their_inertials(with_inertials: WeakProblem) -> None:
    problem = with_inertials
    parts = parts_of(problem.runs)
    refits = Refits.of(problem, fit(problem, problem.nominal()), parts)
    kept = frozenset({UNKNOWNS})
    for number, part in enumerate(parts[:2]):
        rows = problem.rows_of(refits.model(kept, number))[part.rows(problem.runs)]
        assert float(rows @ rows) == pytest.approx(float(refits.chi_square(kept)[number]), rel=1e-6)
