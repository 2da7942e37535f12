"""The tests that an effect must pass beside unknown forces, each broken and kept in turn on a two-joint arm."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.places import ELSEWHERE, joint_of
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import determined, growth_by_place, rivals_by_place
from drake_cafim.diagnosis.search.growth_by_place import (
    GrowthByPlace,
    best_by_place,
    strength_at_bound,
    undetermined_in,
)
from drake_cafim.diagnosis.search.refused import Refused
from drake_cafim.diagnosis.search.search_under_unknown_force import _grows_beside_others
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

VISCOUS = 0.3
"""N m s/rad, at the first joint."""


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def arm_that_rubs(folder: Path, friction: Callable[[Array], Array]) -> GrowthByPlace:
    """A search that begins with nothing, of an arm whose efforts overcome `friction` of v at the first joint."""
    return search_with(folder, lambda u, v: u + friction(v))


def search_with(folder: Path, effort: Callable[[Array, Array], Array]) -> GrowthByPlace:
    """A search that begins with nothing, of an arm whose recorded effort at the first joint is `effort` of u and v."""
    scene, read = written(simulate("null", "arm2", 12), folder)
    joint = scene.tree.joint_names[0]
    changed = [
        replace(part, columns={**part.columns, f"u.{joint}": effort(part[f"u.{joint}"], part[f"v.{joint}"])})
        for part in read
    ]
    problem = prepare(scene, changed).problem()
    assert isinstance(problem, WeakProblem)
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    return growth


def viscous(growth: GrowthByPlace, value: float) -> Effect:
    return effect_named("joint_viscous_friction")(growth.problem.scene.tree.joint_names[0], {"coefficient": value})


def fitted(growth: GrowthByPlace) -> tuple[Fit, Effect]:
    found = fit(growth.problem, growth.best.model.with_effects([viscous(growth, VISCOUS)]))
    return found, found.model.effects[0]


def test_a_fit_with_a_tolerance_ends_early(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    start = growth.best.model.with_effects([viscous(growth, 5.0 * VISCOUS)])
    exact = fit(growth.problem, start)
    asked: list[float] = []
    rows_of = WeakProblem.rows_of

    def counted(problem: WeakProblem, model: Model) -> Array:
        asked.append(1.0)
        return rows_of(problem, model)

    monkeypatch.setattr(WeakProblem, "rows_of", counted)
    near = fit(growth.problem, exact.model.at(exact.model.vector + 0.3 * exact.std))
    without_tolerance, asked = len(asked), []
    rough = fit(growth.problem, exact.model.at(exact.model.vector + 0.3 * exact.std), tolerance=1.0)
    assert len(asked) < without_tolerance
    assert near.chi_square == pytest.approx(exact.chi_square, abs=0.01)
    assert rough.chi_square == pytest.approx(exact.chi_square, abs=1.0)
    far = fit(growth.problem, start, tolerance=1.0)
    assert far.chi_square == pytest.approx(exact.chi_square, abs=1.0)


def test_what_cannot_stand_is_notfitted(growth: GrowthByPlace) -> None:
    """Of several effects those that fail a test to first order are refused, and the others are fitted without them."""
    joint = growth.problem.scene.tree.joint_names[1]
    idle = effect_named("joint_spring")(joint, {"stiffness": 1e-4, "rest": 0.0})
    assert growth._that_may_stand(growth.best, [idle, viscous(growth, VISCOUS)]) == [viscous(growth, VISCOUS)]
    assert growth._that_may_stand(growth.best, [idle]) == []


def test_an_explanation_is_accepted_only_where_its_likelihood_pays(growth: GrowthByPlace) -> None:
    nothing = growth.best
    hidden = effect_named("joint_viscous_friction")(growth.problem.scene.tree.joint_names[1], {"coefficient": 0.01})
    try:
        assert not growth.settle(nothing.model.with_effects([hidden]))
        assert growth.best is nothing and growth.settled_lead == 0.0, "it fails a test"
        assert growth.settle(nothing.model.with_effects([viscous(growth, 0.1)]))
        assert growth.settled_lead < -100.0
        [found] = growth.best.model.effects
        assert found.values["coefficient"] == pytest.approx(VISCOUS, rel=0.02)
        assert not growth.settle(nothing.model), "friction is not given up again"
    finally:
        growth.drop(growth.best.model.effects)


def test_positions_and_velocities_of_a_joint_gain_one_effect_a_round(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = growth.problem.scene.tree.joint_names[:2]
    late = effect_named("sensor_delay")(f"v.{first}", {"delay": 0.005})
    skewed = effect_named("clock_skew")(f"q.{first}", {"skew": 0.01})
    other = effect_named("sensor_gain_error")(f"v.{second}", {"gain": 0.9})
    rubs = viscous(growth, VISCOUS)
    looks = [Candidate(effect, gain, 1, 1) for effect, gain in ((rubs, 4e4), (late, 3e4), (skewed, 2e4), (other, 1e4))]
    monkeypatch.setattr(growth, "_looks", (growth.best, {False: looks}))
    assert [candidate.effect for candidate in growth._promising()] == [rubs, late, other]


def test_a_law_that_took_another_ones_place_is_grown_beside(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a law stood for two and one of them took its place, the other is looked for; else the growth has ended."""
    nothing, second = growth.best, growth.problem.scene.tree.joint_names[1]
    former = effect_named("joint_spring")(second, {"stiffness": 0.1, "rest": 0.0})
    other = effect_named("rotor_inertia")(second, {"inertia": 0.01})
    grown = nothing.model.with_effects([former])
    asked: list[bool] = []
    monkeypatch.setattr(growth, "refused", Refused())
    monkeypatch.setattr(growth, "grow", lambda: asked.append(growth.refused.holds(former, growth.best.model)))
    assert not _grows_beside_others(growth, grown) and not asked
    monkeypatch.setattr(growth, "best", replace(nothing, model=nothing.model.with_effects([other])))
    assert not _grows_beside_others(growth, grown) and asked == [True], "what was dropped is not tried again"
    found = replace(nothing, model=nothing.model.with_effects([other, viscous(growth, VISCOUS)]))
    monkeypatch.setattr(growth, "grow", lambda: setattr(growth, "best", found))
    assert _grows_beside_others(growth, grown)


@pytest.mark.parametrize(("gain", "drag_first"), [(3e4, False), (5e4, True)])
def test_what_acts_elsewhere_comes_first_where_it_gains_more_than_the_joints_together(
    growth: GrowthByPlace, gain: float, drag_first: bool
) -> None:
    """The drag of a link looks like friction at all joints below it, and each of these alone gains less."""
    joints, link = growth.problem.scene.tree.joint_names[:2], growth.problem.scene.tree.bodies[-1].name
    rubs = [effect_named("joint_viscous_friction")(joint, {"coefficient": VISCOUS}) for joint in joints]
    drag = effect_named("aerodynamic_drag")(link)
    looks = [Candidate(drag, gain, 1, 1), *(Candidate(effect, 2e4, 1, 1) for effect in rubs)]
    chosen = [candidate.effect for candidate in best_by_place(growth, looks)]
    assert chosen == ([drag] if drag_first else rubs)


def test_what_acts_once_waits_for_what_lasts(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    joint, link = growth.problem.scene.tree.joint_names[0], growth.problem.scene.tree.bodies[-1].name
    push = effect_named("external_disturbance")(link, {"x": 1.0, "start": 0.0, "stop": 0.2})
    lasting, brief = Candidate(viscous(growth, VISCOUS), 1e4, 1, 1), Candidate(push, 1e6, 3, 1)
    monkeypatch.setattr(growth, "_looks", (growth.best, {False: [lasting], True: [brief]}))
    assert growth._promising() == [lasting]
    monkeypatch.setattr(growth, "refused", Refused({("joint_viscous_friction", joint): frozenset()}))
    assert growth._promising() == [brief]


def test_where_nothing_has_changed_no_candidates_are_looked_for_again(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But before the search ends: what was missing at other joints may have hidden some."""
    first, second = growth.problem.scene.tree.joint_names[:2]
    asked: list[set[str]] = []

    def screened(problem: SearchProblem, at: Fit, effects: list[Effect], jobs: int = 1) -> list[Candidate]:
        asked.append({joint_of(effect) for effect in effects if not effect.brief})
        return [Candidate(effect, 1e6, 1, 1) for effect in effects if joint_of(effect) == second]

    before = growth.best
    monkeypatch.setattr(growth_by_place, "screen", screened)
    monkeypatch.setattr(growth, "_looks", None)
    monkeypatch.setattr(growth, "_before", None)
    try:
        known = growth._promising()
        assert {joint_of(candidate.effect) for candidate in known} == {second}
        assert asked == [{ELSEWHERE, first, second}]
        monkeypatch.setattr(growth, "best", fit(growth.problem, before.model.with_effects([viscous(growth, 0.1)])))
        assert growth._promising() == known
        assert asked[1:] == [{ELSEWHERE, first}]
        monkeypatch.setattr(growth, "refused", Refused())
        growth.refused.add(growth.effects, growth.best.model)
        assert not growth._promising()
        assert asked[2] == {ELSEWHERE, first, second}
    finally:
        growth.best = before


def test_a_strength_at_its_bound_is_told() -> None:
    coulomb = effect_named("joint_load_dependent_friction")
    [torque, coefficient] = coulomb.strengths
    assert strength_at_bound(coulomb("elbow", {"torque": 0.0, "coefficient": 0.2})) == torque.name
    assert strength_at_bound(coulomb("elbow", {"torque": 0.2, "coefficient": coefficient.upper})) == coefficient.name
    assert strength_at_bound(coulomb("elbow", {"torque": 0.2, "coefficient": 0.2})) is None


def test_friction_that_is_many_times_larger_at_rest_is_none() -> None:
    """What a fit says of a joint's reversals by a static torque beyond any that joints have is no Stribeck friction."""
    stribeck = effect_named("joint_stribeck_friction")
    values = {"coulomb": 0.5, "velocity": 0.01}
    assert strength_at_bound(stribeck("elbow", {**values, "static": 0.9})) is None
    assert strength_at_bound(stribeck("elbow", {**values, "static": 4.0})) is None
    assert strength_at_bound(stribeck("elbow", {**values, "static": 5.1})) == "static"


@pytest.mark.long
def test_a_law_whose_strength_ends_at_a_bound_gives_way_to_the_simpler_one(tmp_path: Path) -> None:
    torque, width = 0.4, 0.05
    growth = arm_that_rubs(tmp_path, lambda v: torque * np.tanh(v / width))
    by_load = effect_named("joint_load_dependent_friction")(
        growth.problem.scene.tree.joint_names[0], {"torque": 0.3, "coefficient": 0.0, "slip_velocity": width}
    )
    assert growth.settle(growth.best.model.with_effects([by_load]))
    [found] = growth.best.model.effects
    assert found.name == "joint_coulomb_friction"
    assert found.values["torque"] == pytest.approx(torque, rel=0.05)


def test_what_is_not_determined_is_told(growth: GrowthByPlace) -> None:
    found, effect = fitted(growth)
    assert undetermined_in(found, effect) is None
    vague = replace(found, covariance=found.covariance + 100.0 * np.eye(len(found.covariance)))
    told = undetermined_in(vague, effect)
    assert told is not None and told[0] == "coefficient" and told[1] > told[2] / 3.0


def test_what_blocks_of_time_do_not_determine_is_not_named(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing, first = growth.best, len(growth.trace.records)
    assert growth.settle(nothing.model.with_effects([viscous(growth, 0.1)]))
    try:
        monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: False)
        rivals_by_place._drop_undetermined(growth)
        assert len(growth.best.model.effects) == 1
        wide = growth.best.std + np.append(np.zeros(len(growth.best.model.unknown)), 10.0)
        monkeypatch.setattr(rivals_by_place, "blockwise_std", lambda *given: wide)
        monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: True)
        rivals_by_place._drop_undetermined(growth)
        assert len(growth.best.model.effects) == 1, "white noise is correlated in no block"
        monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: False)
        rivals_by_place._drop_undetermined(growth)
        assert not growth.best.model.effects
        assert [record.test for record in growth.trace.records[first:]][-1] == "undetermined"
    finally:
        growth.drop(growth.best.model.effects)


def test_what_a_report_does_not_determine_is_not_named(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the standard deviations of a report, which may be wider than those of the fit."""
    nothing = growth.best
    assert growth.settle(nothing.model.with_effects([viscous(growth, 0.1)]))
    try:
        [rubbing] = growth.best.model.effects
        position = len(growth.best.model.unknown)
        for stds, named in ((3.5, True), (2.5, False)):
            wide = growth.best.std.copy()
            wide[position] = rubbing.vector[0] / stds
            monkeypatch.setattr(determined, "standard_deviations", lambda *given, wide=wide: wide)
            monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: True)
            rivals_by_place._drop_unknown(growth)
            assert len(growth.best.model.effects) == 1, "where noise is left, an effect is needed"
            monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: False)
            rivals_by_place._drop_unknown(growth)
            assert bool(growth.best.model.effects) == named
        assert growth.trace.records[-1].test == "undetermined"
    finally:
        growth.drop(growth.best.model.effects)


@pytest.mark.parametrize(
    ("of_payload", "gone"),
    [(0.15, [{"first", "second"}, {"payload"}, {"ripple"}]), (0.05, [{"payload"}, {"first", "second"}, {"ripple"}])],
)
def test_what_explains_little_goes_at_all_joints_at_once(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch, of_payload: float, gone: list[set[str]]
) -> None:
    """But what moves the rows of many joints goes alone: beside it the others may explain more."""
    joints, link = growth.problem.scene.tree.joint_names, growth.problem.scene.tree.bodies[-1].name
    asked = {
        "first": (effect_named("joint_spring")(joints[0], {"stiffness": 1.0, "rest": 0.0}), 0.1),
        "ripple": (effect_named("torque_ripple")(joints[0], {"amplitude": 1.0, "cycles": 2.0, "phase": 0.0}), 0.2),
        "second": (effect_named("joint_spring")(joints[1], {"stiffness": 1.0, "rest": 0.0}), 0.3),
        "payload": (effect_named("payload")(link, {"mass": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}), of_payload),
        "friction": (effect_named("joint_viscous_friction")(joints[1], {"coefficient": 1.0}), 0.9),
    }
    share = {effect.key: value for effect, value in asked.values()}
    name = {effect.key: word for word, (effect, _) in asked.items()}
    dropped: list[set[str]] = []
    whole = replace(growth.best, model=growth.best.model.with_effects([effect for effect, _ in asked.values()]))

    def drop(effects: list[Effect]) -> None:
        dropped.append({name[effect.key] for effect in effects})
        left = tuple(effect for effect in growth.best.model.effects if effect not in effects)
        growth.best = replace(growth.best, model=replace(growth.best.model, effects=left))

    monkeypatch.setattr(growth, "best", whole)
    monkeypatch.setattr(growth, "drop", drop)
    monkeypatch.setattr(growth, "drop_failing", lambda: None)
    monkeypatch.setattr(rivals_by_place, "leaves_noise", lambda *given: False)
    monkeypatch.setattr(rivals_by_place, "_share", lambda growth, effects: share[effects[0].key])
    rivals_by_place._drop_unsupported(growth)
    assert dropped == gone
    assert [effect.name for effect in growth.best.model.effects] == ["joint_viscous_friction"]
    monkeypatch.setattr(growth, "best", whole)
    dropped.clear()
    rivals_by_place._drop_unsupported(growth, [effect.key for effect, _ in asked.values()])
    assert not dropped, "what is known to explain more than is left stays"
