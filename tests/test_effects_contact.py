"""Effects of contacts and surfaces: forces against closed forms, and their internal states along a motion."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.contact.change import Touch, surface_axes
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.contact_friction import (
    ContactAnisotropicFriction,
    ContactPresliding,
    ContactRollingResistance,
    ContactStribeckFriction,
)
from drake_cafim.effects.contact_law import ContactLawChange
from drake_cafim.effects.normal_contact import (
    ContactAdhesion,
    ContactHuntCrossleyDissipation,
    ContactNonlinearStiffness,
    ContactViscoelasticRelaxation,
)
from drake_cafim.effects.surface import SurfaceOffset, SurfaceTilt
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

UP = np.array([0.0, 0.0, 1.0])
PARAMETERS = ContactParameters(stiffness=4000.0, damping=40.0, friction=0.4, slip_velocity=0.005)
CONTACT = SphereContact(("tool", "wall"), 0, np.zeros(3), 0.01, np.zeros(3), UP, ContactLaw(), PARAMETERS)
PUSH = 4000.0 * 0.002 + 40.0 * 0.01
LEVEL = float(np.tanh(0.05 / 0.005))


def touch(depth: float = 0.002, rate: float = 0.01, slip: tuple[float, float] = (0.03, -0.04)) -> Touch:
    return many(np.array([depth]), np.array([rate]), np.array([[*slip, 0.0]]), np.zeros((1, 3)))


def many(depth: Array, rate: Array, slip: Array, position: Array) -> Touch:
    return Touch(depth, rate, slip, position, np.zeros_like(slip), np.zeros_like(slip), surface_axes(UP))


def force(effect: ContactEffect, at: Touch) -> Array:
    return CONTACT.changed(effect).force(at)[0][0]


NORMAL: list[tuple[ContactEffect, float]] = [
    (ContactNonlinearStiffness("tool/wall", {"cubic": 1e9}), 1e9 * 0.002**3),
    (ContactHuntCrossleyDissipation("tool/wall", {"dissipation": 5.0}), 4000.0 * 0.002 * 5.0 * 0.01),
    (ContactViscoelasticRelaxation("tool/wall", {"stiffness": 700.0, "time_constant": 0.1}), 700.0 * 0.002),
]


@pytest.mark.parametrize(("effect", "more"), NORMAL)
def test_normal_laws(effect: ContactEffect, more: float) -> None:
    # with nothing remembered, all of the depth is new to a relaxing contact
    x, y, z = force(effect, touch())
    assert z == pytest.approx(PUSH + more)
    assert (x, y) == pytest.approx((-0.4 * z * LEVEL * 0.6, 0.4 * z * LEVEL * 0.8))
    np.testing.assert_array_equal(force(effect, touch(depth=-1e-6, rate=1.0)), 0.0)
    # nothing pulls: a fast release leaves no force
    assert force(effect, touch(rate=-1.0))[2] == 0.0


def test_another_law_replaces_the_scenario_s() -> None:
    # of a sphere on a rigid plane, π E d² (1 − k d) with k = 2/(3 R); nothing remains of the spring and its damper
    effect = ContactLawChange("tool/wall", {"modulus": 6e5, "dissipation": 3.0})
    changed = effect.on(replace(CONTACT, parameters=replace(PARAMETERS, radius=0.01)))
    z = changed.force(touch())[0][0][2]
    assert z == pytest.approx(np.pi * 6e5 * 0.002**2 * (1.0 - 0.002 / 0.015) * (1.0 + 3.0 * 0.01))
    assert effect.numbers({"modulus": 1.0, "law": "hydroelastic"}) == {"modulus": 1.0, "law": 3.0}
    with pytest.raises(InputError, match=r"contact_law\.law is rubber, expected one of hydroelastic"):
        effect.numbers({"law": "rubber"})


def test_friction_of_another_law_has_no_resistance() -> None:
    """A slow tip rubs with μλ at once; by the paper's resistance it would with R|v| only, until that reaches μλ."""
    rubbed = replace(PARAMETERS, radius=0.01, slip_velocity=None, resistance=2.0)
    contact = replace(CONTACT, parameters=rubbed)
    assert np.linalg.norm(contact.force(touch())[0][0, :2]) == pytest.approx(2.0 * 0.05)
    x, y, z = ContactLawChange("tool/wall", {"modulus": 6e5, "dissipation": 3.0}).on(contact).force(touch())[0][0]
    assert np.hypot(x, y) == pytest.approx(0.4 * z * LEVEL)


def test_a_look_at_another_law_leads_to_its_modulus() -> None:
    contact = replace(CONTACT, parameters=replace(PARAMETERS, radius=0.01))
    depth = np.linspace(1e-4, 2e-3, 50)
    flat = np.zeros((50, 3))
    true = ContactLawChange("tool/wall", {"modulus": 6e5, "dissipation": 3.0})
    at = many(depth, 0.005 * np.sin(np.arange(50.0)), flat, flat)
    spring = np.stack([depth, at.rate], axis=1)
    pressed = (contact.force(at)[0][:, 2] > 0.0) & (true.on(contact).force(at)[0][:, 2] > 0.0)
    assert pressed.all()
    missing = (true.on(contact).force(at)[0] - contact.force(at)[0])[:, 2]
    for look in true.looks(contact, at):
        columns = [
            (_normal(true, contact, step.ahead, at) - _normal(true, contact, step.behind, at)) / step.size
            for step in look.steps
        ]
        found = look.build(np.linalg.lstsq(np.column_stack([*columns, spring]), missing, rcond=None)[0][:2])
        assert found is not None
        assert found.values["modulus"] == pytest.approx(6e5, rel=0.02)
        assert found.values["dissipation"] == pytest.approx(3.0, rel=0.02)


def _normal(effect: ContactLawChange, contact: SphereContact, values: Mapping[str, float] | None, at: Touch) -> Array:
    here = contact if values is None else effect.with_values(values).on(contact)
    return here.force(at)[0][:, 2]


def test_adhesion_pulls_and_friction_does_not_feel_it() -> None:
    effect = ContactAdhesion("tool/wall", {"force": 2.0, "range": 1e-3})
    np.testing.assert_allclose(force(effect, touch()), CONTACT.force(touch())[0][0] - 2.0 * UP)
    np.testing.assert_allclose(force(effect, touch(depth=-0.0005)), [0.0, 0.0, -2.0 * np.exp(-0.5)])


def test_stribeck_friction_rises_near_rest() -> None:
    effect = ContactStribeckFriction("wall/tool", {"static": 0.6, "velocity": 0.05})
    friction = np.linalg.norm(force(effect, touch())[:2])
    assert friction == pytest.approx((0.4 + 0.2 * np.exp(-1.0)) * PUSH * LEVEL)
    fast = np.linalg.norm(force(effect, touch(slip=(1.0, 0.0)))[:2])
    assert fast == pytest.approx(0.4 * PUSH)


def test_friction_that_is_the_same_along_all_axes_is_no_anisotropy() -> None:
    def law(values: Array) -> ContactAnisotropicFriction:
        named = zip(("friction_1", "friction_2", "angle"), values.tolist(), strict=True)
        return ContactAnisotropicFriction("tool/wall", dict(named))

    values = np.array([0.7, 0.2, 0.5])
    assert np.allclose(law(np.array([0.6, 0.6, 2.1])).vanishing()[0], 0.0)
    # its axes are the same where the two are swapped and turned by a right angle
    swapped = np.array([0.2, 0.7, 0.5 + 0.5 * np.pi])
    assert np.allclose(law(values).vanishing()[0], law(swapped).vanishing()[0])
    steps = 1e-6 * np.eye(3)
    slopes = [(law(values + step).vanishing()[0] - law(values - step).vanishing()[0]) / 2e-6 for step in steps]
    assert np.allclose(law(values).vanishing()[1], np.transpose(slopes))


def test_anisotropic_friction_has_two_axes() -> None:
    def along(angle: float, first: float = 0.5, second: float = 0.3) -> Array:
        values = {"friction_1": first, "friction_2": second, "angle": angle}
        return force(ContactAnisotropicFriction("tool/wall", values), touch())[:2] / (PUSH * LEVEL)

    np.testing.assert_allclose(along(0.0), [-0.5 * 0.6, 0.3 * 0.8])
    np.testing.assert_allclose(along(0.5 * np.pi), [-0.3 * 0.6, 0.5 * 0.8])
    # e₁ along the sliding: all of μ₁ and nothing across
    np.testing.assert_allclose(along(float(np.arctan2(-0.8, 0.6))), 0.5 * np.array([-0.6, 0.8]))
    np.testing.assert_allclose(along(0.7, 0.4, 0.4), 0.4 * np.array([-0.6, 0.8]))
    at_rest = force(ContactAnisotropicFriction("tool/wall", {"friction_1": 0.5, "friction_2": 0.3, "angle": 0.1}),
                    touch(slip=(0.0, 0.0)))  # fmt: skip
    np.testing.assert_allclose(at_rest, [0.0, 0.0, PUSH])


def test_rolling_resistance_is_a_moment_against_the_rolling() -> None:
    rolling = replace(touch(), w=np.array([[0.0, 2.0, 3.0]]))
    contact = CONTACT.changed(ContactRollingResistance("tool/wall", {"coefficient": 0.003}))
    at, moment = contact.force(rolling)
    np.testing.assert_allclose(moment[0], [0.0, -0.003 * PUSH, 0.0])
    np.testing.assert_allclose(at, CONTACT.force(rolling)[0])
    assert not np.any(contact.force(touch())[1])


def test_relaxation_of_a_steady_press() -> None:
    stiffness, tau, speed, begins = 700.0, 0.05, 0.02, 0.1013
    time = np.sort(np.random.default_rng(1).uniform(0.0, 0.6, 300))
    depth = speed * (np.minimum(time, 0.4) - begins)
    rate = np.where(time < 0.4, speed, 0.0)
    pressed = many(depth, rate, np.zeros((300, 3)), np.zeros((300, 3)))
    effect = ContactViscoelasticRelaxation("tool/wall", {"stiffness": stiffness, "time_constant": tau})
    added = effect.push(pressed, PARAMETERS, effect.recall(time, pressed, pressed))
    peak = stiffness * speed * tau * -np.expm1(-(0.4 - begins) / tau)
    ramp = stiffness * speed * tau * -np.expm1(-(time - begins) / tau)
    closed = np.where(time < begins, 0.0, np.where(time < 0.4, ramp, peak * np.exp(-(time - 0.4) / tau)))
    # the corner at 0.4 s lies between two samples
    away = np.abs(time - 0.4) > 0.01
    np.testing.assert_allclose(added[time < 0.39], closed[time < 0.39], atol=1e-12)
    np.testing.assert_allclose(added[away], closed[away], rtol=0.02, atol=1e-12)


def test_a_release_is_forgotten() -> None:
    time = np.arange(400) * 0.001
    depth = np.where((time > 0.1) & (time < 0.2) | (time > 0.3), 0.001, -0.001)
    pressed = many(depth, np.zeros(400), np.zeros((400, 3)), np.zeros((400, 3)))
    effect = ContactViscoelasticRelaxation("tool/wall", {"stiffness": 700.0, "time_constant": 0.2})
    added = effect.push(pressed, PARAMETERS, effect.recall(time, pressed, pressed))
    np.testing.assert_allclose(added[301:], added[101:200], rtol=1e-9)
    assert not np.any(added[depth < 0.0])


def test_presliding_there_and_back() -> None:
    distance, speed = 2e-4, 0.01
    effect = ContactPresliding("tool/wall", {"distance": distance})
    time = np.arange(161) * 0.001
    x = speed * np.where(time < 0.08, time, 0.16 - time)
    velocity = np.zeros((161, 3))
    velocity[:, 1] = speed * np.where(time < 0.08, 1.0, -1.0)
    velocity[80] = 0.0
    position = np.zeros((161, 3))
    position[:, 1] = x
    slid = many(np.full(161, 0.002), np.zeros(161), velocity, position)
    friction = CONTACT.changed(effect).force(slid, effect.recall(time, slid, slid))[0][:, 1]
    normal = 4000.0 * 0.002
    there = distance * -np.expm1(-x / distance)
    back = -distance + (there[80] + distance) * np.exp(-(x[80] - x) / distance)
    closed = -0.4 * normal / distance * np.where(time <= 0.08, there, back)
    # a step that holds the reversal is straight in the samples: it misses half a step on either side
    np.testing.assert_allclose(friction[:80], closed[:80], atol=1e-9)
    np.testing.assert_allclose(friction[82:], closed[82:], atol=0.05 * 0.4 * normal)


def test_memory_of_steps_is_that_of_samples() -> None:
    time = np.arange(200) * 0.001
    depth = 0.001 * np.sin(30.0 * time)
    velocity = np.stack([0.02 * np.cos(20.0 * time), 0.01 * np.sin(9.0 * time), 0.0 * time], axis=1)
    position = np.stack([0.001 * np.sin(20.0 * time), -0.01 / 9.0 * np.cos(9.0 * time), 0.0 * time], axis=1)
    slid = many(depth, 0.03 * np.cos(30.0 * time), velocity, position)
    contact = CONTACT.changed(ContactPresliding("tool/wall", {"distance": 3e-4})).changed(
        ContactViscoelasticRelaxation("tool/wall", {"stiffness": 900.0, "time_constant": 0.02})
    )
    recalled = contact.force(slid, contact.recall(time, slid, slid))[0]
    memory = np.zeros((1, contact.memory))
    stepped = np.zeros((200, 3))
    for k in range(200):
        now = many(depth[k : k + 1], slid.rate[k : k + 1], velocity[k : k + 1], position[k : k + 1])
        if k == 0:
            memory[:, 3:6] = now.position
        stepped[k] = contact.force(now, memory)[0][0]
        if k < 199:
            middle = many(*(0.5 * (a[k : k + 1] + a[k + 1 : k + 2]) for a in (depth, slid.rate, velocity, position)))
            memory = contact.ahead(memory, middle, np.array([0.001]), np.array([0.0005]))
    np.testing.assert_allclose(stepped, recalled, atol=0.02 * float(np.max(np.abs(recalled))))


def test_surfaces_are_moved() -> None:
    raised = SurfaceOffset("wall", {"offset": 0.003}).on(CONTACT)
    np.testing.assert_allclose(raised.point, [0.0, 0.0, 0.003])
    tilted = SurfaceTilt("wall", {"y_slope_x": 0.1, "y_slope_y": -0.05}).on(CONTACT)
    expected = np.array([-np.tan(0.1), np.tan(0.05), 1.0])
    np.testing.assert_allclose(tilted.normal, expected / np.linalg.norm(expected))
    np.testing.assert_array_equal(tilted.point, 0.0)
    # a wall that stands upright is tilted in its own axes
    wall = replace(CONTACT, normal=np.array([0.0, -1.0, 0.0]))
    turned = SurfaceTilt("wall", {"y_slope_x": 0.1, "y_slope_y": 0.0}).on(wall)
    np.testing.assert_allclose(turned.normal, np.array([-np.sin(0.1), -np.cos(0.1), 0.0]))


def test_where_effects_are_meant() -> None:
    assert ContactAdhesion("wall/tool").meets(CONTACT) and not ContactAdhesion("tool/floor").meets(CONTACT)
    assert SurfaceOffset("wall").meets(CONTACT) and not SurfaceOffset("tool").meets(CONTACT)
    stribeck, dahl = ContactStribeckFriction("tool/wall"), ContactPresliding("tool/wall")
    assert stribeck.excludes(dahl) and not stribeck.excludes(ContactAdhesion("tool/wall"))
