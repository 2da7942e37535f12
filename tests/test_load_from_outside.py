"""The load from outside that motion terms keep is that of the physics that is asked about."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.motion_terms import MotionTerms
from drake_cafim.scenario.physics import Physics
from tests.concealed.make import simulate
from tests.concealed_case import written

Pressed = tuple[MotionTerms, Physics]


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Pressed:
    scene, read = written(simulate("null", "press", 3), tmp_path_factory.mktemp("press"))
    problem = prepare(scene, read[:1]).problem()
    assert isinstance(problem, WeakProblem)
    return problem.forms[0].terms(scene.physics), scene.physics


def _moved_plane(physics: Physics) -> Physics:
    [contact] = physics.contacts
    return replace(physics, contacts=(replace(contact, point=contact.point + 0.01 * contact.normal),))


def _stiffer(physics: Physics) -> Physics:
    [contact] = physics.contacts
    return replace(physics, contacts=(contact.with_parameter("stiffness", 2.0 * contact.parameters.stiffness),))


def _turned(physics: Physics) -> Physics:
    return replace(physics, gravity=physics.gravity + np.array([0.5, 0.0, 0.0]))


def _heavier(physics: Physics) -> Physics:
    *bodies, last = physics.tree.bodies
    return replace(physics, tree=replace(physics.tree, bodies=(*bodies, replace(last, mass=2.0 * last.mass))))


@pytest.mark.parametrize("change", [_moved_plane, _stiffer, _turned, _heavier])
def test_it_follows_what_changes(pressed: Pressed, change: Callable[[Physics], Physics]) -> None:
    terms, physics = pressed
    q = terms.measured.q_hat
    other = change(physics)
    np.testing.assert_array_equal(terms.load(physics), physics.loads(q))
    assert not np.allclose(terms.load(other), physics.loads(q))
    np.testing.assert_array_equal(terms.load(other), other.loads(q))


def test_it_is_computed_once(pressed: Pressed, monkeypatch: pytest.MonkeyPatch) -> None:
    terms, physics = pressed
    known = terms.load(physics)
    monkeypatch.setattr(Physics, "loads", lambda *whatever: pytest.fail("computed again"))
    assert terms.load(replace(physics, joint_forces=())) is known
