"""With unknown inertias, one wrong gain looks like other gains and inertias: friction and gains are fitted together."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import search_under_unknown_force
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

GAIN = 1.3


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    """A search of an arm of three joints: a gain at the second one, friction at all, and all inertias unknown."""
    scene, read = written(simulate("null", "arm3", 12), tmp_path_factory.mktemp("arm"))
    names = scene.tree.joint_names
    laws: dict[str, Callable[[Array, Array], Array]] = {
        names[0]: lambda u, v: u + 0.1 * v + 0.2 * np.tanh(v / 0.005),
        names[1]: lambda u, v: (u + 0.2 * v + 0.3 * np.tanh(v / 0.005)) / GAIN,
        names[2]: lambda u, v: u + 0.05 * v + 0.1 * np.tanh(v / 0.005),
    }
    changed = [
        replace(
            part, columns=part.columns | {f"u.{at}": law(part[f"u.{at}"], part[f"v.{at}"]) for at, law in laws.items()}
        )
        for part in read
    ]
    bare = replace(scene, scenario=replace(scene.scenario, unknown=[])).with_uncertain_inertials(0.1)
    problem = prepare(bare, changed).problem()
    assert isinstance(problem, WeakProblem)
    found = GrowthByPlace.of(problem, problem.nominal(), 200, Settings(), lambda text: None)
    assert found is not None
    return found


def _wrong(growth: GrowthByPlace) -> list[Effect]:
    """A gain where there is none, and the frictions that stand out first beside it."""
    first, second, third = growth.problem.scene.tree.joint_names
    return [
        effect_named("actuator_gain_error")(third, {"gain": 0.75}),
        effect_named("joint_load_dependent_friction")(first, {"torque": 0.1, "coefficient": 0.05}),
        effect_named("joint_viscous_friction")(second, {"coefficient": 0.1}),
        effect_named("joint_coulomb_friction")(second, {"torque": 0.2}),
    ]


def test_a_gain_that_others_stood_for_is_found(growth: GrowthByPlace) -> None:
    first, second, third = growth.problem.scene.tree.joint_names
    growth.take(Model(growth.best.model.unknown, tuple(_wrong(growth))))
    assert search_under_unknown_force._settles_with_gains(growth)
    growth.grow()
    named = {effect.key: effect for effect in growth.best.model.effects}
    friction = {(f"joint_{law}_friction", at) for law in ("viscous", "coulomb") for at in (first, second, third)}
    assert set(named) == {*friction, ("actuator_gain_error", second)}
    assert named["actuator_gain_error", second].values["gain"] == pytest.approx(GAIN, rel=0.01)
    assert named["joint_coulomb_friction", first].values["torque"] == pytest.approx(0.2, rel=0.03)
    # where noise alone is left nothing is tried
    assert not search_under_unknown_force._settles_with_gains(growth)


def test_inertias_that_are_as_stated_stand_for_no_gain(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    own = replace(growth)
    own.take(Model(own.best.model.unknown, tuple(_wrong(own))))
    own.best = replace(own.best, model=replace(own.best.model, unknown=own.nominal.scene.priors.mean))
    tried: list[Model] = []
    monkeypatch.setattr(own, "settle", lambda model: not tried.append(model))
    assert not search_under_unknown_force._settles_with_gains(own) and not tried
    monkeypatch.setattr(search_under_unknown_force, "far_unknowns", lambda scene, model: scene.unknown)
    assert search_under_unknown_force._settles_with_gains(own) and len(tried) == 1


def test_what_cannot_be_fitted_changes_nothing(growth: GrowthByPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    own = replace(growth)
    own.take(Model(own.best.model.unknown, tuple(_wrong(own))))
    monkeypatch.setattr(own, "settle", lambda model: np.linalg.cholesky(-np.eye(2)))
    assert not search_under_unknown_force._settles_with_gains(own)
