"""Compiled steps against those of the physics' own objects."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.contact import NORMAL_LAWS, ContactLaw
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.stepper import State, advance, step
from drake_cafim.discrimination import closed_loop
from drake_cafim.dynamics.motion import motion
from drake_cafim.dynamics.stepping import _solve
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.scenario.physics import Physics
from tests import two_links
from tests.concealed.make import make
from tests.concealed_case import written

RUBBING = ({"slip_velocity": 0.01}, {"resistance": 30.0}, {})


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Physics:
    scene, _ = written(make("null", "press", 5), tmp_path_factory.mktemp("press"))
    return Model(scene.priors.mean).physics(scene)


def _variant(physics: Physics, law: str, rubbing: dict[str, float], smoothing: float) -> Physics:
    [contact] = physics.contacts
    soft = replace(contact.parameters, dissipation=0.7, modulus=1e6, radius=0.02)
    numbers = replace(soft, slip_velocity=None, resistance=None)
    changed = replace(contact, law=ContactLaw(law, smoothing), parameters=replace(numbers, **rubbing))
    return replace(physics, contacts=(changed,))


def _states(physics: Physics, count: int = 60) -> tuple[State, np.ndarray, np.ndarray]:
    """States about the plane, on either side of it, some at rest; with efforts and durations."""
    rng, n = np.random.default_rng(2), len(physics.tree.joints)
    [contact] = physics.contacts
    start = motion(physics.tree, np.zeros((1, n)), np.zeros((1, n)))
    depth, toward = contact.touch(start).penetration, contact.normal @ start.axes[0, :, 3:].T
    q = np.zeros((count, n)) + (depth + rng.normal(0.0, 1e-3, count))[:, None] * toward
    v = rng.normal(0.0, 0.1, (count, n)) * (np.arange(count) % 4 > 0)[:, None]
    return State(q, v, np.zeros((count, 0))), rng.normal(0.0, 5.0, (count, n)), rng.uniform(0.001, 0.002, count)


def _assert_alike(physics: Physics) -> None:
    state, effort, duration = _states(physics)
    slowly = state
    for _ in range(4):
        slowly = step(physics, slowly, effort, duration / 4)
    quickly = advance(physics, state, effort, duration)
    np.testing.assert_allclose(quickly.q, slowly.q, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(quickly.v, slowly.v, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("law", NORMAL_LAWS)
@pytest.mark.parametrize("rubbing", RUBBING)
@pytest.mark.parametrize("smoothing", [0.0, 0.5])
def test_spheres_press_alike(press: Physics, law: str, rubbing: dict[str, float], smoothing: float) -> None:
    physics = _variant(press, law, rubbing, smoothing)
    state, *_ = _states(physics)
    moving = motion(physics.tree, state.q, state.v)
    [contact] = physics.contacts
    wrench = physics.contact_wrenches(moving)[:, contact.joint]
    touched = np.any(wrench != 0.0, axis=1)
    assert np.any(touched) and (smoothing > 0.0 or not np.all(touched))
    np.testing.assert_allclose(wrench, contact.wrench(moving), rtol=1e-12, atol=1e-12)


def test_steps_alike(press: Physics) -> None:
    _assert_alike(press)


def test_joint_laws_step_alike(press: Physics) -> None:
    at = press.tree.joint_names[1]
    friction = effect_named("joint_coulomb_friction")(at, {"torque": 1.0})
    _assert_alike(press.with_effects([friction]))


def test_a_changed_contact_keeps_its_change(press: Physics) -> None:
    [contact] = press.contacts
    effect = effect_named("contact_adhesion")(contact.name, {"force": 1.0, "range": 0.002})
    physics = press.with_effects([effect])
    assert physics.spheres is None
    _assert_alike(physics)


def test_a_singular_inertia_loses_one_simulation_alone() -> None:
    """Once a simulation runs away, its matrix may be singular or no number: the others made beside it go on."""
    A = np.array([[[2.0, 0.0], [0.0, 4.0]], [[1.0, 1.0], [1.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]])
    b = np.ones((3, 2))
    for matrix, vector in zip(A, b, strict=True):
        _solve(matrix, vector)
    np.testing.assert_allclose(b[0], [0.5, 0.25])
    assert np.all(np.isnan(b[1:]))


def _carried_on(
    take: Callable[..., State], physics: Physics, state: State, effort: np.ndarray, size: float, duration: float = 0.1
) -> State:
    """The state after `duration` s in steps of `size` s, by `step` or by `advance`."""
    for _ in range(round(duration / size)):
        state = take(physics, state, effort, np.full(len(effort), size))
    return state


@pytest.mark.parametrize("take", [step, advance])
def test_steps_are_of_second_order_in_a_fast_motion(tmp_path: Path, take: Callable[..., State]) -> None:
    """Centrifugal and Coriolis forces change within a step as the velocities do."""
    physics = two_links.scene(tmp_path, unknown="").physics
    rng = np.random.default_rng(1)
    state, effort = State(rng.normal(0.0, 1.0, (20, 2)), rng.normal(0.0, 8.0, (20, 2))), rng.normal(0.0, 3.0, (20, 2))
    finest = _carried_on(advance, physics, state, effort, 1e-4)
    coarse, fine = (np.abs(_carried_on(take, physics, state, effort, size).v - finest.v).max() for size in (2e-3, 1e-3))
    assert fine < 2e-3 and fine < 0.3 * coarse


def test_a_joint_that_turns_has_friction_of_both_signs_for_their_shares_of_the_step(tmp_path: Path) -> None:
    physics = two_links.scene(tmp_path, unknown="").physics
    frictions = [effect_named("joint_coulomb_friction")(name, {"torque": 0.5}) for name in physics.tree.joint_names]
    physics = physics.with_effects(frictions)
    rng = np.random.default_rng(3)
    state, effort = State(rng.normal(0.0, 0.5, (60, 2)), rng.normal(0.0, 1.0, (60, 2))), rng.normal(0.0, 2.0, (60, 2))
    finest, found = (_carried_on(advance, physics, state, effort, size) for size in (1e-4, 2e-3))
    turned = state.v * finest.v < 0.0
    assert np.count_nonzero(turned) > 20
    assert np.sqrt(np.mean((found.v - finest.v)[turned] ** 2)) < 0.012


def test_dry_friction_holds_joints_at_rest(tmp_path: Path) -> None:
    physics = two_links.scene(tmp_path, unknown="").physics
    frictions = [effect_named("joint_coulomb_friction")(name, {"torque": 8.0}) for name in physics.tree.joint_names]
    rng = np.random.default_rng(0)
    state, effort = State(rng.normal(0.0, 0.2, (40, 2)), rng.normal(0.0, 0.3, (40, 2))), rng.normal(0.0, 1.0, (40, 2))
    stopped = _carried_on(advance, physics.with_effects(frictions), state, effort, 2e-3, duration=0.3)
    assert np.abs(stopped.v).max() < 0.02


def test_planned_motions_are_simulated_by_the_same_rule(tmp_path: Path) -> None:
    """In the discrimination's simulation rotors may move apart from their links; where none does, it is this one."""
    physics = two_links.scene(tmp_path, unknown="").physics
    rng = np.random.default_rng(1)
    q, v, effort = rng.normal(0.0, 1.0, (20, 2)), rng.normal(0.0, 8.0, (20, 2)), rng.normal(0.0, 3.0, (20, 2))
    rotors = np.zeros((20, 0))
    planned = closed_loop._step(physics, closed_loop._State(q, v, rotors, rotors, None), effort, 2e-3)
    alone = step(physics, State(q, v), effort, np.full(20, 2e-3))
    np.testing.assert_allclose(planned.q, alone.q, rtol=1e-12)
    np.testing.assert_allclose(planned.v, alone.v, rtol=1e-12)
