"""The contact simulator of the concealed cases: closed forms, balances of momentum and energy, convergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.concealed.arm_case import Settings
from tests.concealed.contact_law import ContactLaw
from tests.concealed.draw_contact import WRENCH
from tests.concealed.make import simulate
from tests.concealed.press import NAMES, PressPlant, random_stage
from tests.concealed.press_case import simulate_press
from tests.concealed.robots import Array, Link
from tests.concealed.strength_press import PressRows
from tests.concealed.strength_toss import TossRows
from tests.concealed.toss import Shape, Toss, rotation_matrix

LAW = ContactLaw(stiffness=4000.0, damping=40.0, friction=0.4, slip_velocity=0.005)
DOWN = np.array([0.0, 0.0, -9.81])


def force_on(law: ContactLaw, point: list[float], velocity: list[float], hidden: Array | None = None) -> Array:
    p, v = np.array(point).reshape(1, 1, 3), np.array(velocity).reshape(1, 1, 3)
    z = np.zeros((1, 1, ContactLaw.hidden)) if hidden is None else hidden.reshape(1, 1, -1)
    time = np.zeros(1)
    return law.force(time, p, v, z, law.depth(time, p) > 0.0)[0][0, 0]


def test_nominal_law_is_kelvin_voigt_with_smoothed_coulomb() -> None:
    force = force_on(LAW, [0.0, 0.0, -0.002], [0.03, -0.04, -0.01])
    normal = 4000.0 * 0.002 + 40.0 * 0.01
    friction = 0.4 * normal * np.tanh(0.05 / 0.005)
    np.testing.assert_allclose(force, [-friction * 0.6, friction * 0.8, normal], rtol=1e-12)
    np.testing.assert_array_equal(force_on(LAW, [0.0, 0.0, 1e-6], [0.1, 0.0, -1.0]), 0.0)
    np.testing.assert_array_equal(force_on(LAW, [0.0, 0.0, -1e-4], [0.1, 0.0, 1.0]), 0.0)


def test_effects_of_the_law_follow_the_vocabulary() -> None:
    at, slide = [0.0, 0.0, -0.002], [0.03, -0.04, -0.01]
    base = 4000.0 * 0.002 + 40.0 * 0.01
    normal = force_on(replace(LAW, cubic=1e9), at, slide)[2]
    assert normal == pytest.approx(base + 1e9 * 0.002**3)
    assert force_on(replace(LAW, dissipation=5.0), at, slide)[2] == pytest.approx(base + 4000.0 * 0.002 * 5.0 * 0.01)
    pulled = force_on(replace(LAW, adhesion=2.0, adhesion_range=1e-3), at, slide)
    assert pulled[2] == pytest.approx(base - 2.0)
    # Friction sees the pushing part only.
    np.testing.assert_allclose(pulled[:2], force_on(LAW, at, slide)[:2])
    near = force_on(replace(LAW, adhesion=2.0, adhesion_range=1e-3), [0.0, 0.0, 0.0005], slide)
    np.testing.assert_allclose(near, [0.0, 0.0, -2.0 * np.exp(-0.5)])
    slower = force_on(replace(LAW, static=0.6, stribeck_velocity=0.05), at, slide)
    mu = 0.4 + 0.2 * np.exp(-1.0)
    assert np.hypot(*slower[:2]) == pytest.approx(mu * base * np.tanh(10.0))
    along = force_on(replace(LAW, anisotropic=(0.5, 0.3, 0.0)), at, slide)
    np.testing.assert_allclose(along[:2], base * np.tanh(10.0) * np.array([-0.5 * 0.6, 0.3 * 0.8]))
    turned = force_on(replace(LAW, anisotropic=(0.5, 0.3, 0.5 * np.pi)), at, slide)
    np.testing.assert_allclose(turned[:2], base * np.tanh(10.0) * np.array([-0.3 * 0.6, 0.5 * 0.8]))
    assert force_on(replace(LAW, offset=0.001), at, slide)[2] == pytest.approx(base + 4.0)
    tilted = replace(LAW, tilt=(0.05, -0.02))
    np.testing.assert_allclose(
        tilted.normal * np.sqrt(1 + np.tan(0.05) ** 2 + np.tan(0.02) ** 2), [-np.tan(0.05), np.tan(0.02), 1.0]
    )
    bristle = np.array([1e-4, -2e-4, 0.0, 0.0, 0.0])
    held = force_on(replace(LAW, presliding=5e-4), at, slide, bristle)
    np.testing.assert_allclose(held[:2], -0.4 * base * bristle[:2] / 5e-4)
    relaxing = force_on(replace(LAW, relaxing=100.0), at, slide, np.array([0.0, 0.0, 1.5, 0.0, 0.0]))
    assert relaxing[2] == pytest.approx(base + 1.5)


def test_bristle_and_relaxing_force_follow_their_equations() -> None:
    law = replace(LAW, presliding=5e-4, relaxing=800.0, relaxation_time=0.05)
    z = np.array([1e-4, -2e-4, 1.5, 0.0, 0.0]).reshape(1, 1, 5)
    p, v = np.array([[[0.0, 0.0, -0.002]]]), np.array([[[0.03, -0.04, -0.01]]])
    rates = law.force(np.zeros(1), p, v, z, np.array([[True]]))[2][0, 0]
    np.testing.assert_allclose(rates[:2], [0.03 - 0.05 * 1e-4 / 5e-4, -0.04 + 0.05 * 2e-4 / 5e-4])
    assert rates[2] == pytest.approx(800.0 * 0.01 - 1.5 / 0.05)


def test_press_bounces_converge_and_touch_down_is_located() -> None:
    stage = random_stage(np.random.default_rng(2))
    time = np.tile(0.002 * np.arange(400), (1, 1))
    start = np.array([[0.0, 0.0, stage.radius - stage.tip[2] + 0.004]])
    weight = stage.robot.links[2].mass * 9.81

    def command(k: int, q: Array, v: Array) -> Array:
        return np.array([[1.5 * np.sin(0.04 * k), 0.0, weight - 6.0]])

    paths = []
    for tolerance in (1e-8, 1e-12):
        _, motion = simulate_press(stage, LAW, (), time, start, command, None, tolerance)
        paths.append(motion)
    assert np.count_nonzero(np.diff(paths[0].mode[0, :, 0].astype(int))) >= 1
    np.testing.assert_allclose(paths[0].q, paths[1].q, atol=2e-9)
    np.testing.assert_allclose(paths[0].v, paths[1].v, atol=2e-7)


def test_press_wrench_balances_the_axes() -> None:
    case = simulate("null", "press", 3)
    world, plant = case.study["world"], case.study["plant"]
    assert isinstance(plant, PressPlant)
    motion = world.motion
    masses = np.cumsum([link.mass for link in plant.stage.robot.links][::-1])[::-1]
    read = np.stack([world.measured[f"wrench.wrist.{axis}"] for axis in ("fx", "fy", "fz")], axis=2)
    np.testing.assert_allclose(plant.stage.moved * motion.a, motion.u + read + masses * DOWN, atol=1e-6)
    settings = case.study["settings"]
    assert isinstance(settings, Settings)


def ball(law: ContactLaw, height: float = 0.0, **fields: object) -> tuple[Toss, Array]:
    radius, mass = 0.04, 0.2
    link = Link("ball", mass, np.zeros(3), np.eye(3) * 0.4 * mass * radius**2)
    start = np.zeros((1, 13))
    start[0, 2], start[0, 3] = radius + height, 1.0
    return Toss(link, Shape(radius), law, DOWN, copies=1, **fields), start  # type: ignore[arg-type]


def test_toss_flies_on_a_parabola_and_rests_on_its_spring() -> None:
    toss, start = ball(LAW, 1.0)
    start[0, 7:13] = [0.5, -0.2, 1.0, 1.0, 2.0, 3.0]
    time = 0.004 * np.arange(60)[None]
    states = toss.run(time, start)
    np.testing.assert_allclose(states[0, -1, 2], 1.04 + time[0, -1] - 0.5 * 9.81 * time[0, -1] ** 2, atol=1e-9)
    np.testing.assert_allclose(states[0, -1, 10:13], [1.0, 2.0, 3.0], atol=1e-10)
    toss, start = ball(LAW)
    states = toss.run(0.004 * np.arange(500)[None], start)
    assert 0.04 - states[0, -1, 2] == pytest.approx(0.2 * 9.81 / 4000.0, rel=1e-4)


def test_sliding_ball_slows_by_friction_until_it_rolls() -> None:
    toss, start = ball(LAW)
    start[0, 2] -= 0.2 * 9.81 / 4000.0
    start[0, 7] = 1.0
    states = toss.run(0.002 * np.arange(400)[None], start)
    # A homogeneous sphere ends up rolling at 5/7 of its first speed; its lever is the radius less 0.5 mm of depth.
    assert states[0, -1, 7] == pytest.approx(5.0 / 7.0, rel=5e-3)
    early = states[0, 25, 7]
    assert early == pytest.approx(1.0 - 0.4 * 9.81 * 0.05, rel=1e-3)
    resisted, start_2 = ball(replace(LAW, rolling=0.002))
    start_2[0] = start[0]
    slowed = resisted.run(0.002 * np.arange(400)[None], start_2)
    # Rolling, the deceleration is 5/7 coefficient g / radius.
    rate = (slowed[0, 250, 7] - slowed[0, 380, 7]) / (130 * 0.002)
    assert rate == pytest.approx(5.0 / 7.0 * 0.002 * 9.81 / 0.04, rel=0.03)


def test_tumbling_box_keeps_spin_and_converges_through_impacts() -> None:
    extents = (0.1, 0.07, 0.12)
    squares = np.array(extents) ** 2
    link = Link("block", 0.3, np.zeros(3), 0.3 / 12.0 * np.diag(squares.sum() - squares))
    link = link.with_point_mass(0.05, np.array([0.02, 0.01, -0.03]))
    toss = Toss(
        link, Shape(extents=extents), replace(LAW, stiffness=2000.0, damping=5.0, slip_velocity=0.01), DOWN, copies=1
    )
    start = np.zeros((1, 13))
    start[0, :7] = [0.0, 0.0, 0.25, 0.8, 0.36, 0.48, 0.0]
    start[0, 7:] = [0.4, 0.2, 0.3, 3.0, -2.0, 4.0]
    time = 0.004 * np.arange(110)[None]
    tight, loose = toss.run(time, start, 1e-12), toss.run(time, start, 1e-8)
    np.testing.assert_allclose(loose[0, :, :3], tight[0, :, :3], atol=1e-6)
    inertia = [
        rotation_matrix(s[None, 3:7])[0] @ link.inertia @ rotation_matrix(s[None, 3:7])[0].T @ s[10:13]
        for s in tight[0, :20]
    ]
    np.testing.assert_allclose(inertia, np.tile(inertia[0], (20, 1)), atol=1e-10)
    assert tight[0, -1, 2] < 0.2


@pytest.mark.parametrize(("rig", "rows"), [("press", PressRows), ("toss", TossRows)])
def test_strength_of_a_null_is_nothing(rig: str, rows: type[PressRows] | type[TossRows]) -> None:
    excess = rows(simulate("null", rig, 3)).excess()
    assert np.mean(excess.remaining() ** 2) < 0.02


def test_noisy_press_null_is_white_at_its_stated_noise() -> None:
    """The wrench less the true law at measured q and v, whitened: a mean square of one a row, whatever the seed."""
    squares = []
    for seed in (1, 3):
        case = simulate("null", "press", seed)
        rows = PressRows(case)
        law = case.study["true_law"]
        assert isinstance(law, ContactLaw)
        tables = [table for name, table in case.recordings.items() if name.startswith("train")]
        q, v = (np.stack([table[[f"{kind}.{name}" for name in NAMES]].to_numpy() for table in tables]) for kind in "qv")
        read = np.stack([table[[f"wrench.wrist.{axis}" for axis in WRENCH]].to_numpy() for table in tables])
        squares.append(np.mean(rows.whiten(read - rows.wrench(law, q, v))[:, :, :6] ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.06)
