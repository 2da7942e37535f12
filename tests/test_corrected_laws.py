"""Effects in a Drake Diagram: accelerations and measured channels follow the laws that the diagnosis uses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator

from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.recoveries.cases import REMEMBERING
from tests.recoveries.instant import NOW, built, drake_acceleration, entry
from tests.recoveries.models import ARM, PRESS, ROLLER, SERVED, STAGE, scene_of
from tests.recoveries.rig import CONTINUOUS

JOINT: list[tuple[str, str, dict[str, float]]] = [
    ("joint_viscous_friction", "turn", {"coefficient": 0.7}),
    ("joint_coulomb_friction", "lift", {"torque": 0.6}),
    ("joint_asymmetric_coulomb_friction", "lift", {"torque_positive": 0.6, "torque_negative": 0.2}),
    ("joint_stribeck_friction", "elbow", {"coulomb": 0.3, "static": 0.8, "velocity": 0.4}),
    ("joint_load_dependent_friction", "elbow", {"torque": 0.2, "coefficient": 0.05}),
    ("joint_spring", "turn", {"stiffness": 3.0, "rest": 0.2}),
    ("joint_hard_stop", "lift", {"position": 0.1, "stiffness": 30.0, "damping": 0.5, "side": 1.0}),
    ("torque_ripple", "turn", {"amplitude": 0.4, "cycles": 18.0, "phase": 0.7}),
    ("rotor_inertia", "elbow", {"inertia": 0.05}),
    ("actuator_speed_limit", "lift", {"no_load_speed": 4.0, "stall_torque": 0.8}),
]
ACTUATOR: list[tuple[str, str, dict[str, float]]] = [
    ("actuator_gain_error", "lift", {"gain": 0.8}),
    ("actuator_bias", "elbow", {"torque": -0.5}),
    ("actuator_saturation", "lift", {"limit": 0.8}),
    ("actuator_dead_zone", "turn", {"width": 0.3}),
]
SERVO: list[tuple[str, str, dict[str, float]]] = [
    ("servo_gain_error", "lift", {"gain": 0.8}),
    ("servo_dead_band", "elbow", {"width": 0.05}),
    ("supply_sag", "turn", {"sag": 0.02}),
]
LINK: list[tuple[str, str, dict[str, Any]]] = [
    ("payload", "l3", {"mass": 0.6, "x": 0.2, "y": -0.05, "z": 0.1}),
    ("inertial_error", "l3", {"mass": -0.3, "com_x": 0.02, "com_z": -0.03, "ixx": 0.01, "izz": 0.004, "ixy": 1e-3}),
    ("gravity_misalignment", "world", {"roll": 0.1, "pitch": -0.2}),
    ("aerodynamic_drag", "l3", {"coefficient": 0.9}),
    ("external_disturbance", "l2", {"x": 4.0, "y": -3.0, "z": 7.0, "interval": [0.1, 0.5]}),
    ("unmodeled_contact", "l3", {"offset": 3.0, "stiffness": 20.0, "damping": 2.0, "nx": 0.1, "ny": 0.2, "nz": 1.0}),
]
CONTACT: list[tuple[str, str, dict[str, float]]] = [
    ("contact_stribeck_friction", "tool/wall", {"static": 0.9, "velocity": 0.3}),
    ("contact_adhesion", "tool/wall", {"force": 3.0, "range": 1e-3}),
    ("contact_nonlinear_stiffness", "tool/wall", {"cubic": 5e8}),
    ("contact_hunt_crossley_dissipation", "tool/wall", {"dissipation": 4.0}),
    ("contact_law", "tool/wall", {"modulus": 6e5, "dissipation": 3.0}),
    ("contact_anisotropic_friction", "tool/wall", {"friction_1": 0.7, "friction_2": 0.2, "angle": 0.5}),
    ("contact_rolling_resistance", "tool/wall", {"coefficient": 0.002}),
    ("surface_offset", "wall", {"offset": 0.0007}),
    ("surface_tilt", "wall", {"y_slope_x": 0.01, "y_slope_y": -0.02}),
]
SENSOR: list[tuple[str, str, dict[str, float]]] = [
    ("sensor_bias", "q.y", {"bias": 0.02}),
    ("sensor_gain_error", "v.x", {"gain": 1.1}),
    ("sensor_drift", "wrench.wrist.fz", {"rate": 0.5}),
    ("sensor_misalignment", "wrench.wrist", {"roll": 0.1, "pitch": 0.2, "yaw": -0.3}),
]


def expected_acceleration(scene: Scene, q: Array, v: Array, u: Array) -> Array:
    """v̇ (n,) by the physics that a diagnosis simulates."""
    physics = scene.physics
    acting = u.copy()
    for effect in physics.actuators:
        j = scene.tree.joint_index(effect.at)
        acting[j] = effect.drive(Effort(np.zeros(1), acting[j : j + 1])).values[0]
    moving = motion(physics.tree, q[None], v[None])
    joints = [JointSamples(q[j : j + 1], v[j : j + 1], acting[j : j + 1]) for j in range(len(q))]
    M, bias = equations_of_motion(moving, physics.gravity)
    M = M + np.diag(physics.rotor_inertias)
    wrenches = physics.contact_wrenches(moving) + physics.body_wrenches(moving, np.array([NOW]))
    force = acting[None] - bias + moving.project(wrenches) + physics.applied_at_joints(joints)[0]
    return np.asarray(np.linalg.solve(M[0], force[0]))


@pytest.mark.parametrize(("name", "at", "values"), [("", "", {}), *JOINT, *ACTUATOR, *LINK])
def test_arm_accelerates_as_the_law_says(name: str, at: str, values: dict[str, Any], tmp_path: Path) -> None:
    scene = scene_of(tmp_path, ARM, *([entry(name, at, values)] if name else []))
    bare = scene_of(tmp_path, ARM)
    rng, seen = np.random.default_rng(5), 0.0
    for _ in range(3):
        q, v, u = rng.uniform(-1.0, 1.0, 3), rng.uniform(-1.5, 1.5, 3), rng.uniform(-2.0, 2.0, 3)
        expected = expected_acceleration(scene, q, v, u)
        np.testing.assert_allclose(drake_acceleration(scene, q, v, u, CONTINUOUS), expected, rtol=1e-9, atol=1e-9)
        # a discrete plant takes damping and brakes implicitly: to first order in its step the same
        stepped = drake_acceleration(scene, q, v, u, MultibodyPlantConfig(time_step=1e-6))
        np.testing.assert_allclose(stepped, expected, rtol=1e-4, atol=1e-3)
        seen = max(seen, float(np.max(np.abs(expected - expected_acceleration(bare, q, v, u)))))
    assert not name or seen > 0.1


@pytest.mark.parametrize(("name", "at", "values"), [("", "", {}), *SERVO])
def test_servos_drive_the_arm_as_the_law_says(name: str, at: str, values: dict[str, float], tmp_path: Path) -> None:
    effects = [entry(name, at, values)] if name else []
    scene, free = scene_of(tmp_path, ARM, *effects, **SERVED), scene_of(tmp_path, ARM)
    rng = np.random.default_rng(7)
    for _ in range(4):
        q, v, beside = rng.uniform(-0.5, 0.5, 3), rng.uniform(-1.0, 1.0, 3), rng.uniform(-2.0, 2.0, 3)
        command = q + rng.uniform(-0.2, 0.2, 3)
        error = command - q
        kp = np.array(
            [300.0 * (values.get("gain", 1.0) if joint == at else 1.0) for joint in ("turn", "lift", "elbow")]
        )
        if name == "servo_dead_band":
            error[2] -= np.clip(error[2], -0.05, 0.05)
        asked = np.clip(kp * error, -40.0, 40.0)
        effort = asked - 8.0 * v
        if name == "supply_sag":
            effort[0] /= 1.0 + np.sign(asked[0] * effort[0]) * 0.02 * asked[0] ** 2 / 40.0
        corrected, diagram, context = built(scene)
        corrected.servo["command"].FixValue(
            corrected.servo["command"].get_system().GetMyContextFromRoot(context), command
        )
        diagram.GetInputPort("effort").FixValue(context, beside)
        own = corrected.plant.GetMyMutableContextFromRoot(context)
        corrected.plant.SetPositionsAndVelocities(own, np.concatenate([q, v]))
        found = diagram.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
        np.testing.assert_allclose(found, expected_acceleration(free, q, v, effort + beside), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "at", "values"), [("", "", {}), *CONTACT])
def test_tool_is_pushed_as_the_law_says(name: str, at: str, values: dict[str, float], tmp_path: Path) -> None:
    scene = scene_of(tmp_path, STAGE, *([entry(name, at, values)] if name else []), **PRESS)
    rng = np.random.default_rng(6)
    for z in (0.019, 0.0193, 0.0202):
        q = np.array([*rng.uniform(-0.1, 0.1, 2), z])
        v, u = rng.uniform(-0.3, 0.3, 3), rng.uniform(-5.0, 5.0, 3)
        expected = expected_acceleration(scene, q, v, u)
        for config in (CONTINUOUS, MultibodyPlantConfig(time_step=1e-6)):
            found = drake_acceleration(scene, q, v, u, config)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
        moving = motion(scene.tree, q[None], v[None])
        corrected, _, context = built(scene)
        own = corrected.plant.GetMyMutableContextFromRoot(context)
        corrected.plant.SetPositionsAndVelocities(own, np.concatenate([q, v]))
        wrench = scene.physics.contact_wrenches(moving)[:, 2]
        port = corrected.measured["wrench.wrist"]
        found = port.Eval(port.get_system().GetMyContextFromRoot(context))
        np.testing.assert_allclose(found, scene.wrench_sensors[0].reading(moving, wrench)[0], atol=1e-9)


def roller(folder: Path, *effects: dict[str, Any]) -> Scene:
    return scene_of(folder, ROLLER, *effects, **PRESS)


def test_rolling_is_resisted_as_the_law_says(tmp_path: Path) -> None:
    effect = entry("contact_rolling_resistance", "tool/wall", {"coefficient": 0.002})
    q, v, u = np.array([0.1, 0.019, 0.3]), np.array([0.05, -0.01, 0.8]), np.array([1.0, 2.0, 0.1])
    resisted, free = (expected_acceleration(roller(tmp_path, *stated), q, v, u) for stated in ([effect], []))
    assert abs(resisted[2] - free[2]) > 0.1
    np.testing.assert_allclose(drake_acceleration(roller(tmp_path, effect), q, v, u, CONTINUOUS), resisted, rtol=1e-9)


@pytest.mark.parametrize("model", ["point", "hydroelastic"])
@pytest.mark.parametrize(("name", "at", "values"), CONTACT)
def test_drakes_own_contact_does_the_same_beyond_its_law(
    name: str, at: str, values: dict[str, float], model: str, tmp_path: Path
) -> None:
    q, v, u = np.array([0.1, 0.019, 0.3]), np.array([0.05, -0.01, 0.8]), np.array([1.0, 2.0, 0.1])
    found = []
    for step in (0.0, 1e-6):
        config = MultibodyPlantConfig(time_step=step, contact_model=model)
        with_it, without = (
            drake_acceleration(roller(tmp_path, *stated), q, v, u, config, contact="drake")
            for stated in ([entry(name, at, values)], [])
        )
        assert without[1] > 0.0  # Drake's contact pushes against gravity and the tool's weight
        found.append(with_it - without)
    scenes = roller(tmp_path, entry(name, at, values)), roller(tmp_path)
    expected = np.subtract(*(expected_acceleration(scene, q, v, u) for scene in scenes))
    assert np.max(np.abs(expected)) > 0.05
    np.testing.assert_allclose(found[0], expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found[1], expected, rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize(("model", "step"), [("point", 0.0), ("point", 1e-3), ("hydroelastic", 1e-3)])
def test_the_sensor_feels_drakes_contact(model: str, step: float, tmp_path: Path) -> None:
    scene = roller(tmp_path, entry("contact_adhesion", "tool/wall", {"force": 1.0, "range": 1e-3}))
    config = MultibodyPlantConfig(time_step=step, contact_model=model)
    corrected, diagram, context = built(scene, config, contact="drake")
    diagram.GetInputPort("effort").FixValue(context, np.zeros(3))
    corrected.plant.SetPositions(corrected.plant.GetMyMutableContextFromRoot(context), [0.0, 0.0195, 0.0])
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(0.3)
    wrench = corrected.measured["wrench.wrist"]
    fz = wrench.Eval(wrench.get_system().GetMyContextFromRoot(simulator.get_context()))[2]
    # at rest the wall carries the lifter and the tool, and what adhesion pulls
    assert fz == pytest.approx(1.8 * 9.81, rel=0.01)


@pytest.mark.parametrize(("name", "at", "values"), SENSOR)
def test_channels_are_what_the_sensor_writes(name: str, at: str, values: dict[str, float], tmp_path: Path) -> None:
    raw = {**PRESS, "channels": {**PRESS["channels"], "pose.tool": {"std": {"position": 1e-4, "rotation": 1e-3}}}}
    scene, bare = scene_of(tmp_path, STAGE, entry(name, at, values), **raw), scene_of(tmp_path, STAGE, **raw)
    read = []
    for each in (scene, bare):
        corrected, diagram, context = built(each)
        context.SetTime(NOW)
        diagram.GetInputPort("effort").FixValue(context, [1.0, 2.0, 3.0])
        state = [0.1, -0.2, 0.019, 0.02, 0.04, 0.01]
        corrected.plant.SetPositionsAndVelocities(corrected.plant.GetMyMutableContextFromRoot(context), state)
        port = corrected.measured["channels"]
        values_ = port.Eval(port.get_system().GetMyContextFromRoot(context))
        read.append(dict(zip(corrected.columns, values_, strict=True)))
    written, true = read
    assert [true[f"{kind}.{axis}"] for kind in "qvu" for axis in "xyz"] == pytest.approx([*state, 1.0, 2.0, 3.0])
    assert [true[f"pose.tool.{axis}"] for axis in ("x", "y", "z", "qw")] == pytest.approx([0.1, -0.2, 0.019, 1.0])
    assert true["wrench.wrist.fz"] == pytest.approx(4000.0 * 0.001 - 40.0 * 0.01)
    [effect] = scene.physics.sensors
    on = effect.channels(list(true))
    expected = effect.measured(np.array([NOW]), np.array([[true[column] for column in on]]))[0]
    assert [written[column] for column in on] == pytest.approx(list(expected))
    assert all(written[column] != true[column] for column in on)
    assert all(written[column] == true[column] for column in true if column not in on)


def test_every_effect_of_the_vocabulary_is_here() -> None:
    tried = {name for name, *_ in (*JOINT, *ACTUATOR, *SERVO, *LINK, *CONTACT, *SENSOR)}
    assert tried | REMEMBERING == {effect.name for effect in EFFECTS}


def test_unknowns_and_effects_are_one_inertia(tmp_path: Path) -> None:
    unknown = [
        {"parameter": "mass", "body": "l2", "mean": 1.1, "std": 0.1},
        {"parameter": "com_y", "body": "l3", "mean": 0.06, "std": 0.1},
        {"parameter": "inertia", "body": "l3", "mean": 1.5, "std": 0.1},
        {"parameter": "damping", "joint": "turn", "mean": 0.4, "std": 0.1},
        {"parameter": "rotor_inertia", "joint": "lift", "mean": 0.1, "std": 0.1},
    ]
    scene = scene_of(tmp_path, ARM, entry("rotor_inertia", "lift", {"inertia": 0.02}), unknown=unknown)
    q, v, u = np.array([0.1, 0.5, -0.4]), np.array([0.6, -0.3, 0.8]), np.array([0.5, -1.0, 0.2])
    found = drake_acceleration(scene, q, v, u, CONTINUOUS)
    # a change of moments alone rides on a nanogram
    np.testing.assert_allclose(found, expected_acceleration(scene, q, v, u), rtol=1e-7)


def test_a_scene_that_is_faced_anew_has_its_effects_once(tmp_path: Path) -> None:
    effects = [
        entry("aerodynamic_drag", "l3", {"coefficient": 0.9}),
        entry("joint_backlash", "turn", {"gap": 0.01, "stiffness": 100.0, "damping": 1.0}),
    ]
    physics = scene_of(tmp_path, ARM, *effects).with_surfaces_at(np.array([0.1, 0.2, 0.3])).physics
    assert len(physics.body_forces) == 1 and len(physics.couplings) == 1


def test_locked_joints_are_held(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, ARM, lock={"lift": 0.4})
    q, v, u = np.array([0.1, -0.4]), np.array([0.6, 0.8]), np.array([0.5, 0.2])
    found = drake_acceleration(scene, q, v, u, CONTINUOUS)
    np.testing.assert_allclose(found, expected_acceleration(scene, q, v, u), rtol=1e-9)


@pytest.mark.parametrize(
    ("effect", "config", "message"),
    [
        (
            entry("joint_coulomb_friction", "lift", {"torque": 1.0}),
            MultibodyPlantConfig(discrete_contact_approximation="tamsi"),
            "TAMSI lets brakes slip",
        ),
        (
            entry("joint_elasticity", "lift", {"stiffness": 1e5, "damping": 1.0}),
            MultibodyPlantConfig(time_step=1e-3),
            "expected at most 0.00032 s, or 0 for a continuous plant",
        ),
        (
            entry("sensor_bias", "q.wrist", {"bias": 1.0}),
            CONTINUOUS,
            r"effects\[0\]\.at is q\.wrist, expected one of q\.turn, q\.lift",
        ),
    ],
)
def test_what_cannot_be_simulated(
    effect: dict[str, Any], config: MultibodyPlantConfig, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        built(scene_of(tmp_path, ARM, effect), config)
