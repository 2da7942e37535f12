"""Forces on bodies: their laws, and the pulse that the search looks for."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.dynamics.motion import motion
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance, pulse
from drake_cafim.scene.scene import Scene

ARM = """<robot name="two"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0.1"/><mass value="2"/>
<inertia ixx=".02" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".02"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.1 0.05 0"/><mass value="1"/>
<inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".01"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="9"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="50" velocity="9"/></joint></robot>"""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "arm.urdf").write_text(ARM)
    return Scene.from_model(tmp_path / "arm.urdf", weld=["base"])


def test_generalized_force_is_the_power_of_the_force(scene: Scene) -> None:
    """τ·v equals f·v of the point, for drag at the centre of mass and a push at the origin."""
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, 50, 2))
    moving = motion(scene.tree, q, v)
    body = scene.tree.body("lower")
    time = np.full(50, 0.5)
    for effect in (
        AerodynamicDrag("lower", {"coefficient": 0.7}),
        ExternalDisturbance("lower", {"x": 1.0, "y": -2.0, "z": 3.0, "start": 0.0, "stop": 1.2}, "a.csv"),
    ):
        physics = scene.physics.with_effects([effect])
        tau = moving.project(physics.body_wrenches(moving, time, "a.csv"))
        p_WP, v_WP = moving.point(body.joint, body.p_JB + body.R_JB @ effect.point(body))
        force = effect.force(p_WP, v_WP, time, "a.csv")
        assert np.allclose(np.sum(tau * v, axis=1), np.sum(force * v_WP, axis=1))
        unit = moving.force_at(body.joint, body.p_JB + body.R_JB @ effect.point(body))
        assert np.allclose(np.einsum("nja,na->nj", unit, force), tau)


def test_drag_brakes_with_the_square_of_the_speed() -> None:
    v = np.array([[3.0, 0.0, 4.0]])
    assert np.allclose(AerodynamicDrag("b", {"coefficient": 0.2}).force(v, v, None, None), -0.2 * 5.0 * v)


def test_a_push_is_felt_in_its_own_recording_and_interval() -> None:
    push = ExternalDisturbance("b", {"x": 2.0, "y": 0.0, "z": 0.0, "start": 1.0, "stop": 1.5}, "a.csv")
    time = np.array([0.9, 1.0, 1.25, 1.5, 2.0])
    still = np.zeros((5, 3))
    assert np.allclose(push.force(still, still, time, "a.csv")[:, 0], [0, 0, 2.0, 0, 0], atol=1e-12)
    assert not push.force(still, still, time, "b.csv").any() and not push.force(still, still, None, None).any()
    assert push.with_values(np.array([1.0, 0, 0, 1, 2])).recording == "a.csv"
    assert not push.with_values({**push.values, "stop": 0.5}).plausible()


def test_pulse() -> None:
    time = np.linspace(0, 3, 3001)
    shape = pulse(time, 1.0, 2.0)
    assert np.trapezoid(shape, time) == pytest.approx(0.5) and shape.max() == pytest.approx(1.0)


def test_a_push_is_absent_where_its_impulse_is() -> None:
    """Of a short one a hard push and a brief one look alike: neither alone is told from none, both together are."""
    push = ExternalDisturbance("lower", {"x": 1.0, "y": -2.0, "z": 0.0, "start": 0.3, "stop": 0.4}, "a.csv")
    impulse, slope = push.vanishing()
    np.testing.assert_allclose(impulse, [0.1, -0.2, 0.0])
    steps = 1e-6 * np.eye(5)
    ahead, behind = ([push.with_values(push.vector + sign * step).vanishing()[0] for step in steps] for sign in (1, -1))
    np.testing.assert_allclose(slope, (np.transpose(ahead) - np.transpose(behind)) / 2e-6, atol=1e-8)
    harder_and_briefer = np.array([1.0, -2.0, 0.0, 0.0, -0.1])
    np.testing.assert_allclose(slope @ harder_and_briefer, 0.0, atol=1e-12)
