"""Effects in Drake against the formulas of the vocabulary, written out for a pendulum, a tool and a rolling tool."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.recoveries.instant import NOW, drake_acceleration, entry
from tests.recoveries.models import PRESS, ROLLER, STAGE, scene_of
from tests.recoveries.rig import CONTINUOUS

PENDULUM = """<robot name="pendulum" xmlns:drake="http://drake.mit.edu"><link name="base"/><link name="l"><inertial>
<origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="0.03" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/></joint>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="j"/><actuator name="j">
<drake:rotor_inertia value="0.02"/><drake:gear_ratio value="1"/></actuator></transmission></robot>"""
J, WEIGHT = 0.03 + 0.2**2 + 0.02, 0.2 * 9.81
"""kg m² about the joint, and the moment N m of gravity on the level pendulum, which turns it downwards."""
Q, U = 0.3, 1.7


def sign(v: float) -> float:
    return float(np.tanh(v / 0.005))


def pulling(torque: float, inertia: float = J) -> float:
    return (WEIGHT * np.cos(Q) + torque) / inertia


def heavier(v: float) -> float:
    m, x, z = 0.6, 0.2, 0.1
    return pulling(U + m * 9.81 * (x * np.cos(Q) + z * np.sin(Q)), J + m * (x**2 + z**2))


def tilted(v: float) -> float:
    roll, pitch = 0.1, -0.2
    g_x, g_z = -9.81 * np.sin(pitch), -9.81 * np.cos(roll) * np.cos(pitch)
    p_x, p_z = 0.2 * np.cos(Q), -0.2 * np.sin(Q)
    return (p_z * g_x - p_x * g_z + U) / J


SWINGING: list[tuple[str, str, dict[str, float], Callable[[float], float]]] = [
    ("joint_viscous_friction", "j", {"coefficient": 0.7}, lambda v: pulling(U - 0.7 * v)),
    ("joint_coulomb_friction", "j", {"torque": 0.6}, lambda v: pulling(U - 0.6 * sign(v))),
    (
        "joint_asymmetric_coulomb_friction",
        "j",
        {"torque_positive": 0.6, "torque_negative": 0.2},
        lambda v: pulling(U - (0.6 if v > 0.0 else 0.2) * sign(v)),
    ),
    (
        "joint_stribeck_friction",
        "j",
        {"coulomb": 0.3, "static": 0.8, "velocity": 0.4},
        lambda v: pulling(U - (0.3 + 0.5 * np.exp(-((v / 0.4) ** 2))) * sign(v)),
    ),
    (
        "joint_load_dependent_friction",
        "j",
        {"torque": 0.2, "coefficient": 0.05},
        lambda v: pulling(U - (0.2 + 0.05 * U) * sign(v)),
    ),
    ("joint_spring", "j", {"stiffness": 3.0, "rest": 0.2}, lambda v: pulling(U - 3.0 * (Q - 0.2))),
    (
        "joint_hard_stop",
        "j",
        {"position": 0.1, "stiffness": 30.0, "damping": 0.5, "side": 1.0},
        lambda v: pulling(U - 30.0 * (Q - 0.1) - 0.5 * v),
    ),
    ("rotor_inertia", "j", {"inertia": 0.05}, lambda v: pulling(U, J + 0.05)),
    (
        "torque_ripple",
        "j",
        {"amplitude": 0.4, "cycles": 18.0, "phase": 0.7},
        lambda v: pulling(U + 0.4 * np.sin(18.0 * Q + 0.7)),
    ),
    ("actuator_saturation", "j", {"limit": 0.8}, lambda v: pulling(0.8)),
    ("actuator_gain_error", "j", {"gain": 0.8}, lambda v: pulling(0.8 * U)),
    ("actuator_bias", "j", {"torque": -0.5}, lambda v: pulling(U - 0.5)),
    ("actuator_dead_zone", "j", {"width": 0.3}, lambda v: pulling(U - 0.3)),
    ("payload", "l", {"mass": 0.6, "x": 0.2, "y": -0.05, "z": 0.1}, heavier),
    ("gravity_misalignment", "world", {"roll": 0.1, "pitch": -0.2}, tilted),
    ("aerodynamic_drag", "l", {"coefficient": 90.0}, lambda v: pulling(U - 0.2 * 90.0 * abs(0.2 * v) * 0.2 * v)),
]


@pytest.mark.parametrize(("name", "at", "values", "formula"), SWINGING, ids=lambda x: x if isinstance(x, str) else "")
def test_a_pendulum(
    name: str, at: str, values: dict[str, float], formula: Callable[[float], float], tmp_path: Path
) -> None:
    scene = scene_of(tmp_path, PENDULUM, entry(name, at, values))
    for v in (0.4, -0.3, 0.002):
        state = np.array([Q]), np.array([v]), np.array([U])
        found = drake_acceleration(scene, *state, CONTINUOUS)
        assert found[0] == pytest.approx(formula(v), rel=1e-9)
        assert abs(formula(v) - pulling(U)) > 1e-3 or abs(v) < 0.01


K, C, MU, WIDTH = 4000.0, 40.0, 0.4, 0.004
D, V = 0.0008, np.array([0.03, -0.02, 0.01])
"""m that the tool is in the wall, and its velocity m/s."""
SPEED = float(np.hypot(V[0], V[1]))
NOMINAL = K * D - C * V[2]


def pushed(normal: float, friction: float = MU, pull: float = 0.0) -> list[float]:
    """Forces N on the tool."""
    along = -friction * normal * np.tanh(SPEED / WIDTH) * V[:2] / SPEED
    return [*along, normal - pull]


def across(angle: float, first: float, second: float) -> list[float]:
    e_1, e_2 = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    tensor = first * np.outer(e_1, e_1) + second * np.outer(e_2, e_2)
    return [*(-NOMINAL * np.tanh(SPEED / WIDTH) * tensor @ V[:2] / SPEED), NOMINAL]


def leaning(slope_x: float, slope_y: float) -> list[float]:
    n = np.array([-np.tan(slope_x), -np.tan(slope_y), 1.0])
    n /= np.linalg.norm(n)
    depth, rate = 0.02 - n @ np.array([0.1, -0.05, 0.02 - D]), -n @ V
    slip = V - (n @ V) * n
    speed = float(np.linalg.norm(slip))
    normal = K * depth + C * rate
    return list(normal * n - MU * normal * np.tanh(speed / WIDTH) * slip / speed)


WAVE = float(np.sin(np.pi * (NOW - 0.1) / 0.4) ** 2)
PRESSED: list[tuple[str, str, dict[str, Any], list[float]]] = [
    (
        "contact_stribeck_friction",
        "tool/wall",
        {"static": 0.9, "velocity": 0.03},
        pushed(NOMINAL, 0.4 + 0.5 * float(np.exp(-((SPEED / 0.03) ** 2)))),
    ),
    ("contact_adhesion", "tool/wall", {"force": 3.0, "range": 1e-3}, pushed(NOMINAL, pull=3.0)),
    ("contact_nonlinear_stiffness", "tool/wall", {"cubic": 5e8}, pushed(NOMINAL + 5e8 * D**3)),
    ("contact_hunt_crossley_dissipation", "tool/wall", {"dissipation": 4.0}, pushed(NOMINAL - K * D * 4.0 * V[2])),
    (
        "contact_anisotropic_friction",
        "tool/wall",
        {"friction_1": 0.7, "friction_2": 0.2, "angle": 0.5},
        across(0.5, 0.7, 0.2),
    ),
    ("surface_offset", "wall", {"offset": 0.0007}, pushed(NOMINAL + K * 0.0007)),
    ("surface_tilt", "wall", {"y_slope_x": 0.004, "y_slope_y": -0.003}, leaning(0.004, -0.003)),
    (
        "external_disturbance",
        "tool",
        {"x": 4.0, "y": -3.0, "z": 7.0, "interval": [0.1, 0.5]},
        list(pushed(NOMINAL) + WAVE * np.array([4.0, -3.0, 7.0])),
    ),
    (
        "unmodeled_contact",
        "tool",
        {"offset": 0.03, "stiffness": 20.0, "damping": 2.0, "nx": 0.0, "ny": 0.0, "nz": 1.0},
        list(pushed(NOMINAL) + np.array([0.0, 0.0, 20.0 * (0.03 - 0.02 + D) - 2.0 * V[2]])),
    ),
]


@pytest.mark.parametrize(("name", "at", "values", "force"), PRESSED, ids=lambda x: x if isinstance(x, str) else "")
def test_a_tool_on_a_wall(name: str, at: str, values: dict[str, Any], force: list[float], tmp_path: Path) -> None:
    scene, q = scene_of(tmp_path, STAGE, entry(name, at, values), **PRESS), np.array([0.1, -0.05, 0.02 - D])
    found = drake_acceleration(scene, q, V, np.zeros(3), CONTINUOUS) + np.array([0.0, 0.0, 9.81])
    np.testing.assert_allclose(found * [3.8, 1.8, 0.8], force, rtol=1e-9)
    assert np.max(np.abs(np.subtract(force, pushed(NOMINAL)))) > 0.1


def test_a_rolling_tool(tmp_path: Path) -> None:
    effect = entry("contact_rolling_resistance", "tool/wall", {"coefficient": 0.002})
    scene, turning = scene_of(tmp_path, ROLLER, effect, **PRESS), 0.8
    found = drake_acceleration(
        scene, np.array([0.1, 0.02 - D, 0.3]), np.array([V[0], V[2], turning]), np.zeros(3), CONTINUOUS
    )
    slip = V[0] - 0.02 * turning
    friction = -MU * NOMINAL * np.tanh(slip / WIDTH)
    assert found[0] * 3.8 == pytest.approx(friction, rel=1e-9)
    assert found[2] * 0.01 == pytest.approx(-0.02 * friction - 0.002 * NOMINAL, rel=1e-6)
