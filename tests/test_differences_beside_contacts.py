"""Derivatives beside a contact: its terms are evaluated only where the parameter acts on it, or on its reading."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints import differences
from drake_cafim.diagnosis.joints.differences import Differences
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.recordings import read
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.make import simulate


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    """A press that touches a wall, with a wrench sensor."""
    folder = tmp_path_factory.mktemp("press")
    simulate("null", "press", 21).write(folder)
    return prepare(Scene.load(folder / "scenario.yaml"), [read(folder / "train_1.parquet")])


@pytest.mark.parametrize(
    ("name", "at", "values", "strength", "evaluated"),
    [
        ("joint_stribeck_friction", "pz", {"coulomb": 2.0, "static": 3.0, "velocity": 0.02}, 2, False),
        ("actuator_lag", "py", {"time_constant": 0.004}, 0, False),
        ("actuator_gain_error", "pz", {"gain": 1.1}, 0, True),
        ("sensor_gain_error", "wrench.wrist.fz", {"gain": 1.05}, 0, True),
    ],
)
def test_contacts_are_evaluated_where_they_change(
    pressed: Prepared,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    at: str,
    values: dict[str, float],
    strength: int,
    evaluated: bool,
) -> None:
    scene, [weak] = pressed.scene, pressed.weak
    presliding = effect_named("contact_presliding")
    beside = presliding("tool/wall", {each.name: each.typical for each in presliding.strengths})
    model = Model(scene.priors.mean, (beside, effect_named(name)(at, values)))
    calls: list[Physics] = []
    contact_rows = WeakForm.contact_rows

    def counted(self: WeakForm, physics: Physics) -> Array:
        calls.append(physics)
        return contact_rows(self, physics)

    up, down, _ = Differences(scene, (), lambda _: np.zeros(0)).beside(model, 1, strength)
    ahead, behind = up.physics(scene), down.physics(scene)
    whole = weak.residual(ahead) - weak.residual(behind)
    with monkeypatch.context() as patch:
        patch.setattr(WeakForm, "contact_rows", counted)
        change = differences._change_of_rows(weak, ahead, behind)
    assert np.any(whole) and (len(calls) > 0) == evaluated
    np.testing.assert_allclose(change, whole, rtol=0.0, atol=1e-9 * float(np.abs(weak.residual(ahead)).max()))


def test_a_contact_of_other_numbers_is_evaluated(pressed: Prepared) -> None:
    """A parameter of its law, and a place, act on the rows of a contact whose other numbers are the same objects."""
    scene, [weak] = pressed.scene, pressed.weak
    physics = Model(scene.priors.mean).physics(scene)
    [contact] = physics.contacts
    for other in (contact.with_parameter("stiffness", 1.01 * contact.parameters.stiffness), contact.raised(1e-4)):
        ahead = replace(physics, contacts=(other,))
        change = differences._change_of_rows(weak, ahead, physics)
        assert np.any(change)
        np.testing.assert_allclose(change, weak.residual(ahead) - weak.residual(physics), rtol=1e-9, atol=1e-9)
