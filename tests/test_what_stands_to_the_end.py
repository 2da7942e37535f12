"""What was found is tested again beside the laws that have come since, and compared with what is alike elsewhere."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.rivals import Rivals
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.fit.without_effects import noise_beside
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import decisions_by_place, friction_by_joint, growth_by_place, rivals_by_place
from drake_cafim.diagnosis.search.friction_by_joint import Friction
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.refused import Refused
from drake_cafim.diagnosis.search.search import fit_nominal
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, doubt_at_rest
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written
from tests.test_growth_by_place import VISCOUS, arm_that_rubs, viscous


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def test_an_effect_that_comes_to_nothing_beside_others_is_dropped(growth: GrowthByPlace) -> None:
    """The drag of a link stood for friction, and ends at zero beside it; noise alone is left."""
    own = replace(growth, trace=Trace())
    drag = effect_named("aerodynamic_drag")(own.problem.scene.tree.bodies[1].name, {"coefficient": 0.0})
    own.take(own.best.model.with_effects([viscous(own, VISCOUS), drag]))
    own.drop_failing(1.0)
    assert [effect.name for effect in own.best.model.effects] == ["joint_viscous_friction"]
    (record,) = own.trace.records
    assert record.asked.startswith("aerodynamic_drag") and not record.passed
    compared = rivals_by_place.compare_by_place(own)
    assert set(compared.probability) >= {own.best.model.effects[0].key} and len(own.best.model.effects) == 1


@pytest.mark.parametrize("badly", [0.0, 1.0])
def test_what_fails_a_little_stays_while_laws_may_still_change(
    growth: GrowthByPlace, badly: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = replace(growth, trace=Trace())
    faint = effect_named("rotor_inertia")(own.problem.scene.tree.joint_names[1], {"inertia": 1e-6})
    own.take(own.best.model.with_effects([viscous(own, VISCOUS), faint]))
    record = decisions_by_place.record_wald(own.best.model, faint, 1.0, 2.0)
    monkeypatch.setattr(own, "_failure", lambda problem, found, it: (record, 0.5) if it.key == faint.key else None)
    own.drop_failing(badly)
    assert (faint.key in own.best.model.keys) == (badly > 0.5)
    assert own.trace.records == (() if badly > 0.5 else (record,))


@pytest.mark.parametrize("fails", [False, True])
def test_of_effects_that_are_turned_away_together_each_is_tried_alone(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    """Unless all but one of them failed a test, so that this one was alone."""
    own, joints = replace(growth, trace=Trace(), refused=Refused()), growth.problem.scene.tree.joint_names[:2]
    right, wrong = viscous(growth, VISCOUS), effect_named("rotor_inertia")(joints[1], {"inertia": 1e-6})
    looks = [[Candidate(effect, 1e4, 1, 1) for effect in (right, wrong)], []]
    tried: list[frozenset[Key]] = []

    def settle(model: Model, needed: Collection[Key] = ()) -> bool:
        tried.append(model.keys)
        own.failed |= {wrong.key} if fails else set()
        if wrong.key in model.keys:
            return False
        own.take(model)
        return True

    monkeypatch.setattr(own, "_promising", lambda: looks.pop(0))
    monkeypatch.setattr(own, "_that_may_stand", lambda beside, additions: list(additions))
    monkeypatch.setattr(own, "_settle_pair", lambda: False)
    monkeypatch.setattr(own, "settle", settle)
    own.grow()
    together = frozenset({right.key, wrong.key})
    assert tried == [together] if fails else tried == [together, frozenset({right.key}), together]
    assert own.best.model.keys == (frozenset() if fails else {right.key})
    assert own.refused.holds(wrong, own.best.model)


def test_a_gain_error_is_compared_with_that_of_other_joints(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only ratios of efforts to inertias show; of all else, what acts at another joint is no rival."""
    first, second = growth.problem.scene.tree.joint_names[:2]
    asked: list[Effect] = []
    monkeypatch.setattr(rivals_by_place, "screen", lambda problem, best, laws, *of: asked.extend(laws) or [])
    for name, values, elsewhere in (
        ("actuator_gain_error", {"gain": 0.9}, {("actuator_gain_error", second)}),
        ("actuator_bias", {"torque": 0.1}, set()),
    ):
        asked.clear()
        found = fit(growth.problem, growth.best.model.with_effects([effect_named(name)(first, values)]))
        rivals_by_place._contenders(replace(growth, best=found), found.model.effects[0])
        assert {law.key for law in asked if law.at == second} == elsewhere
        assert {law.name for law in asked if law.at == first} > {"joint_coulomb_friction"}


def test_rivals_at_other_joints_are_looked_for_again_when_these_change(growth: GrowthByPlace) -> None:
    first, second = growth.problem.scene.tree.joint_names[:2]
    gain = effect_named("actuator_gain_error")(first, {"gain": 0.9})
    bias = effect_named("actuator_bias")(first, {"torque": 0.1})
    before = fit(growth.problem, growth.best.model.with_effects([gain, bias]))
    other = effect_named("joint_spring")(second, {"stiffness": 0.1, "rest": 0.0})
    after = replace(before, model=before.model.with_effects([other]), covariance=np.eye(len(before.model.vector) + 2))
    known = Rivals.of(before, {gain.key: [], bias.key: []})
    assert set(known.at(after, whitened=False)) == {bias.key}
    assert set(known.at(before, whitened=False)) == {gain.key, bias.key}


@pytest.mark.parametrize(
    ("gain", "noise_alone", "stands"), [(40.0, True, True), (5.0, True, False), (40.0, False, False)]
)
def test_a_larger_friction_stands_by_its_fit_where_its_strengths_are_far_from_linear(
    growth: GrowthByPlace, gain: float, noise_alone: bool, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fall near rest whose velocity is hardly known, beside which χ² of Coulomb friction is higher by `gain`."""
    joint = growth.problem.scene.tree.joint_names[0]
    values = {"coulomb": 0.2, "static": 0.3, "velocity": 0.2}
    larger = fit(
        growth.problem, growth.best.model.with_effects([effect_named("joint_stribeck_friction")(joint, values)])
    )
    larger = replace(larger, covariance=1e-8 * np.eye(len(larger.model.vector)))
    coulomb = growth.best.model.with_effects([effect_named("joint_coulomb_friction")(joint, {"torque": 0.2})])
    simpler = Fit(coulomb, larger.residual, larger.jacobian[:, :-2], np.eye(2), larger.data_rows, penalty=gain)
    options = [Friction(found, found.model.effects) for found in (larger, simpler)]
    monkeypatch.setattr(friction_by_joint, "leaves_noise", lambda *of: noise_alone)
    monkeypatch.setattr(friction_by_joint, "blockwise_std", lambda problem, found: 1e-4 * np.ones(len(found.std)))
    monkeypatch.setattr(friction_by_joint, "strength_at_bound", lambda law: None)
    monkeypatch.setattr(friction_by_joint, "undetermined_in", lambda *of: None)
    shown = iter([1e3, 10.0])
    own: Any = SimpleNamespace(
        problem=growth.problem,
        nominal=SimpleNamespace(plausible=lambda model: True),
        shown=lambda *of: next(shown),
        threshold=growth.threshold,
        settings=growth.settings,
    )
    failure = friction_by_joint.failure_of(own, options[0], options)
    assert (failure is None) == stands


@pytest.mark.long
def test_unknown_inertials_that_made_up_for_effects_come_back(tmp_path: Path) -> None:
    """From where the nominal fit leaves them, at their bounds, a fit with the effects that are there ended far away."""
    case = simulate("many", "arm3", 1)
    scene, read = written(case, tmp_path)
    problem, nominal = fit_nominal(prepare(scene, read).problem(), Trace())
    force = problem.likeliest_force(nominal.model)
    assert force is not None
    values = [{name: value for name, (value, _) in item.parameters.items()} for item in case.study["world"].effects]
    items = zip(case.study["world"].effects, values, strict=True)
    effects = [effect_named(item.effect)(item.at, own) for item, own in items]
    own = problem.with_unknown_force(1e-3 * force, nominal.model)
    far = fit(own, Model(nominal.model.unknown).with_effects(effects), tolerance=CONVERGED)
    near = fit(own, Model(scene.priors.mean).with_effects(effects), tolerance=CONVERGED)
    assert np.max(np.abs((nominal.model.unknown - scene.priors.mean) / scene.priors.std)) > 4.9
    assert far.chi_square == pytest.approx(near.chi_square, rel=0.01)
    assert np.max(np.abs((far.model.unknown - scene.priors.mean) / scene.priors.std)) < 4.9


@pytest.mark.parametrize(("force", "low", "high"), [(1e-2, 0.0, 0.3), (0.0, 0.9, 1.0)])
def test_forces_that_are_too_large_beside_a_law_are_seen(
    growth: GrowthByPlace, force: float, low: float, high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unknown forces as large as what is left without a law hide how well it is determined beside what it leaves."""
    problem = growth.nominal.with_unknown_force(np.full(2, force)) if force else growth.nominal
    found = fit(problem, growth.best.model.with_effects([viscous(growth, VISCOUS)]))
    (law,) = found.model.effects
    left = noise_beside(problem, found, law)
    assert low < left <= high
    # the std by what is left is nearer to that beside the channels' noise, and no less
    exact = fit(growth.nominal, found.model).std[-1]
    assert 0.9 * exact < left * found.std[-1] <= found.std[-1]
    # a size of which the std is a fourth by what is left, and more than a third by these forces
    size = 4.0 * left * float(found.std[-1])
    asked: list[float] = []

    def undetermined(of: Fit, effect: Effect, std: Array) -> tuple[str, float, float] | None:
        asked.append(float(std[-1]) / size)
        return ("coefficient", float(std[-1]), size) if std[-1] > size / 3.0 else None

    monkeypatch.setattr(growth_by_place, "undetermined_in", undetermined)
    failure = growth._failure(problem, found, law)
    assert asked == [pytest.approx(0.25)] and (failure is None or failure[0].test != "undetermined")


def test_explanations_are_compared_with_each_whitened_under_itself(
    growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = replace(growth, trace=Trace(), _own=None)
    own.take(own.best.model.with_effects([viscous(own, VISCOUS)]))
    own.converge()
    asked: list[Model] = []
    under = own._under_force_of
    monkeypatch.setattr(own, "_under_force_of", lambda model: asked.append(model) or under(model))
    before = growth_by_place._own_evidence(own)
    assert growth_by_place._own_evidence(own) == before and len(asked) == 1, "it is computed once"
    # one that was whitened under something else seems better than it is, and what is there would be turned away
    monkeypatch.undo()
    nothing = replace(growth, trace=Trace(), _own=None)
    nothing.best = replace(nothing.best, penalty=nothing.best.penalty - 1e7)
    assert nothing.settle(nothing.best.model.with_effects([viscous(nothing, VISCOUS)]))
    assert [effect.name for effect in nothing.best.model.effects] == ["joint_viscous_friction"]


def test_the_doubt_at_rest_of_a_dry_friction_has_no_jump() -> None:
    """From widths that the velocity's error hides to those that it does not, by which models are compared."""
    v, std = np.linspace(-0.02, 0.02, 41), 0.003
    joint = JointSamples(np.zeros_like(v), v, np.zeros_like(v), v_std=np.full_like(v, std))

    def share(**width: float) -> Array:
        return doubt_at_rest(JointCoulombFriction("pan", {"torque": 1.0, **width}), joint)[1]

    widths = std * np.geomspace(0.2, 20.0, 400)
    shares = np.array([share(slip_velocity=float(width)) for width in widths])
    assert np.max(np.abs(np.diff(shares, axis=0))) < 0.03
    np.testing.assert_allclose(shares[0], 1.0 - np.abs(joint.sign(float(widths[0])).value), atol=2e-3)
    assert np.max(shares[-1]) < 0.02, "the error hides nothing of a width of twenty times its size"
    assert np.max(share()) > 0.9, "of a width that is not known, nothing is known at rest"
