"""Fast computations for concealed cases against slow ones of the same quantities."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from tests.concealed.inverse import Moving
from tests.concealed.make import seen_in, simulate
from tests.concealed.mujoco_arm import mjcf
from tests.concealed.recursion import followed
from tests.concealed.robots import Array, Robot, random_arm
from tests.concealed.small import cross, quaternion_rate, turn_of
from tests.concealed.strength import Windows
from tests.concealed.uneven import sums_of


def engine_torque(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    model = mujoco.MjModel.from_xml_string(mjcf(robot, 1))
    data, out = mujoco.MjData(model), []
    order = [model.joint(f"{joint.name}_0").dofadr[0] for joint in robot.joints]
    for row in zip(q, v, a, strict=True):
        data.qpos[order], data.qvel[order], data.qacc[order] = row
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse[order])
    return np.array(out)


@pytest.mark.parametrize(("seed", "size"), [(1, 2), (2, 7), (3, 6), (4, 6)])
def test_efforts_of_all_samples_are_those_of_the_engine(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, size, branched=size == 6)
    robot = robot.replace_joint(0, damping=0.3)
    if size == 6:
        robot = replace(
            robot, joints=(*robot.joints[:1], replace(robot.joints[1], kind="prismatic"), *robot.joints[2:])
        )
    q, v, a = rng.normal(size=(3, 20, size))
    moving = Moving(robot, q, v, a)
    expected = engine_torque(robot, q, v, a)
    np.testing.assert_allclose(moving.efforts(), expected, atol=1e-12 * np.abs(expected).max())
    body = robot.links[-1]
    heavier = body.with_point_mass(2.0, np.array([0.1, -0.2, 0.05]))
    more = engine_torque(robot.replace_link(size - 1, heavier), q, v, a) - expected
    carried = moving.carried(size - 1, heavier) - moving.carried(size - 1, body)
    np.testing.assert_allclose(carried, more, atol=1e-11 * np.abs(expected).max())


def test_sums_of_uneven_samples_are_those_of_a_spline_through_all() -> None:
    rng = np.random.default_rng(5)
    time = 0.002 * np.arange(700) + np.append(0.0, rng.uniform(-0.0003, 0.0003, 699))
    values = rng.normal(size=(1, 700, 2))
    windows = Windows.over(700, 0.002)
    even = CubicSpline(time, values[0], axis=0)(0.002 * np.arange(700))
    for weight, (sums,) in zip(windows.shape, sums_of(windows, time[None], windows.shape), strict=True):
        expected = windows.integrate(even[None], weight)[0]
        np.testing.assert_allclose(sums @ values[0], expected, atol=1e-12 * np.abs(expected).max())


def test_a_recursion_by_doubling_is_the_recursion() -> None:
    rng = np.random.default_rng(6)
    keep, fed = rng.uniform(0.0, 1.0, (2, 37)), rng.normal(size=(2, 37, 3))
    expected = fed.copy()
    for k in range(1, 37):
        expected[:, k] += keep[:, k, None] * expected[:, k - 1]
    np.testing.assert_allclose(followed(keep, fed), expected, atol=1e-13)


def test_tables_multiply_vectors_and_quaternions() -> None:
    rng = np.random.default_rng(7)
    first, other, q = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.normal(size=(4, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    np.testing.assert_allclose(cross(first, other), np.cross(first, other), atol=1e-15)
    np.testing.assert_allclose(turn_of(q), Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix(), atol=1e-14)
    vector = q[:, :1] * first + np.cross(first, q[:, 1:])
    scalar = -np.sum(first * q[:, 1:], axis=1, keepdims=True)
    np.testing.assert_allclose(quaternion_rate(q, first), 0.5 * np.hstack([scalar, vector]), atol=1e-15)


def test_names_on_a_stage_are_reckoned_anew_for_another_excess() -> None:
    rows, excess = seen_in(simulate("single:surface_offset", "press", 3))
    item = rows.effects[0]
    looks = rows.alternatives(item, excess)
    assert rows.alternatives(item, excess) is looks
    other = rows.alternatives(item, replace(excess, rows=-excess.rows))
    found, changed = (
        next(look.regressors for look in every if look.effect == "surface_offset") for every in (looks, other)
    )
    assert not np.allclose(found, changed)
