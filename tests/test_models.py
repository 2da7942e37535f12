"""The packaged models against the published numbers that their files name."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context

from drake_cafim import models
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests import two_links

# Franka Control Interface documentation, "Denavit-Hartenberg parameters" (Craig's convention) and "Limits for Panda"
FRANKA_A = [0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088]  # m
FRANKA_D = [0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0]  # m
FRANKA_ALPHA = [0.0, -np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, np.pi / 2]  # rad
FRANKA_FLANGE = 0.107  # m
FRANKA_UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]  # rad
FRANKA_LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]  # rad
FRANKA_SPEED = [2.175] * 4 + [2.61] * 3  # rad/s
FRANKA_EFFORT = [87.0] * 4 + [12.0] * 3  # N m
# Gaz et al., RA-L 4(4), 2019: links 0 to 7, kg
FRANKA_MASSES = [0.629769, 4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
# SimLab's allegro_hand_description_right: the palm, four links and a tip a finger, the thumb; kg
ALLEGRO_MASSES = [0.4154, *[0.0119, 0.065, 0.0355, 0.0096, 0.0168] * 3, 0.0176, 0.0119, 0.038, 0.0388, 0.0168]
ALLEGRO_LOWER = [-0.47, -0.196, -0.174, -0.227] * 3 + [0.263, -0.105, -0.189, -0.162]  # rad
ALLEGRO_UPPER = [0.47, 1.61, 1.709, 1.618] * 3 + [1.396, 1.163, 1.644, 1.719]  # rad


@dataclass(frozen=True)
class Loaded:
    plant: MultibodyPlant
    instance: ModelInstanceIndex
    context: Context


def load(name: str, root: str) -> Loaded:
    plant = MultibodyPlant(0.001)
    parser = Parser(plant)
    models.add_to_package_map(parser)
    (instance,) = parser.AddModelsFromUrl(f"package://drake_cafim_models/{name}.urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(root))
    plant.Finalize()
    return Loaded(plant, instance, plant.CreateDefaultContext())


@pytest.fixture(scope="module")
def arm() -> Loaded:
    return load("arm7", "link0")


@pytest.fixture(scope="module")
def hand() -> Loaded:
    return load("hand", "palm")


def flange_position(arm: Loaded, q: Array) -> Array:
    arm.plant.SetPositions(arm.context, q)
    pose = arm.plant.GetFrameByName("flange").CalcPoseInWorld(arm.context)
    return np.asarray(pose.translation())


def craig_transform(a: float, alpha: float, d: float, theta: float) -> Array:
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]])


def test_package_resolves_once_and_again() -> None:
    parser = Parser(MultibodyPlant(0.0))
    models.add_to_package_map(parser)
    models.add_to_package_map(parser)
    assert Path(parser.package_map().GetPath("drake_cafim_models"), "arm7.urdf").is_file()


@pytest.mark.parametrize("path", sorted(Path(models.__file__).parent.glob("*.urdf")), ids=lambda path: path.stem)
def test_every_model_loads_with_physical_inertias(path: Path) -> None:
    plant = MultibodyPlant(0.001)
    (instance,) = Parser(plant).AddModels(path)
    plant.Finalize()
    for index in plant.GetBodyIndices(instance):
        assert plant.get_body(index).default_spatial_inertia().IsPhysicallyValid()


def test_arm_mass(arm: Loaded) -> None:
    total = arm.plant.CalcTotalMass(arm.context)
    assert total == pytest.approx(sum(FRANKA_MASSES), abs=1e-9)
    assert total == pytest.approx(18.0, rel=0.08)  # the data sheet's "about 18 kg" counts covers and cables


def test_arm_limits(arm: Loaded) -> None:
    plant = arm.plant
    np.testing.assert_allclose(plant.GetPositionLowerLimits(), FRANKA_LOWER)
    np.testing.assert_allclose(plant.GetPositionUpperLimits(), FRANKA_UPPER)
    np.testing.assert_allclose(plant.GetVelocityUpperLimits(), FRANKA_SPEED)
    np.testing.assert_allclose(plant.GetEffortUpperLimits(), FRANKA_EFFORT)


def test_arm_forward_kinematics_by_denavit_hartenberg(arm: Loaded) -> None:
    generator = np.random.default_rng(0)
    for _ in range(20):
        q = generator.uniform(FRANKA_LOWER, FRANKA_UPPER)
        X = np.eye(4)
        for a, alpha, d, theta in zip(FRANKA_A, FRANKA_ALPHA, FRANKA_D, q, strict=True):
            X = X @ craig_transform(a, alpha, d, theta)
        expected = X @ np.array([0.0, 0.0, FRANKA_FLANGE, 1.0])
        np.testing.assert_allclose(flange_position(arm, q), expected[:3], atol=1e-9)


def test_arm_at_its_ready_posture(arm: Loaded) -> None:
    ready = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
    # the well-known ready pose: 0.3069 m ahead, 0.5903 m up
    np.testing.assert_allclose(flange_position(arm, ready), [0.3069, 0.0, 0.5903], atol=1e-4)


def test_arm_reach(arm: Loaded) -> None:
    shoulder = np.array([0.0, 0.0, 0.333])
    elbow, wrist = np.meshgrid(np.linspace(-0.8, -0.0698, 60), np.linspace(-0.0175, 3.7525, 200))
    reach = max(
        float(np.linalg.norm(flange_position(arm, np.array([0, 0, 0, q4, 0, q6, 0])) - shoulder))
        for q4, q6 in zip(elbow.ravel(), wrist.ravel(), strict=True)
    )
    assert reach == pytest.approx(0.855, abs=0.005)  # Franka Emika Panda data sheet: 855 mm


def test_arm_reflected_inertia(arm: Loaded) -> None:
    inertias = [
        arm.plant.get_joint_actuator(index).default_rotor_inertia()
        for index in arm.plant.GetJointActuatorIndices(arm.instance)
    ]
    # Drake's franka_description README, Franka's figures for the FR3
    np.testing.assert_allclose(inertias, [0.605721456] * 2 + [0.462474144] * 2 + [0.205544064] * 3)


def test_hand_joints_and_limits(hand: Loaded) -> None:
    plant = hand.plant
    assert plant.num_positions() == plant.num_actuators() == 16
    np.testing.assert_allclose(plant.GetPositionLowerLimits(), ALLEGRO_LOWER)
    np.testing.assert_allclose(plant.GetPositionUpperLimits(), ALLEGRO_UPPER)
    np.testing.assert_allclose(plant.GetEffortUpperLimits(), 0.7)


def test_hand_mass_and_finger_length(hand: Loaded) -> None:
    plant = hand.plant
    assert plant.CalcTotalMass(hand.context) == pytest.approx(sum(ALLEGRO_MASSES), abs=1e-9)
    plant.SetPositions(hand.context, np.zeros(16))
    last = plant.GetFrameByName("middle_3").CalcPoseInWorld(hand.context).translation()
    np.testing.assert_allclose(last, [0.0, 0.0, 0.0007 + 0.0164 + 0.054 + 0.0384], atol=1e-12)


def test_tennis_ball_is_within_the_rules() -> None:
    ball = load("tennis_ball", "ball")
    assert 0.0560 <= ball.plant.CalcTotalMass(ball.context) <= 0.0594  # kg, ITF Rules of Tennis, appendix I
    text = (Path(models.__file__).parent / "tennis_ball.urdf").read_text()
    assert 0.0654 <= 2 * float(text.split('<sphere radius="')[1].split('"')[0]) <= 0.0686  # m


def test_a_weld_of_what_the_file_holds_already_names_the_joint(tmp_path: Path) -> None:
    path, model = two_links.scenario(tmp_path), tmp_path / "two_links.urdf"
    held = '<link name="world"/><joint name="mount" type="fixed"><parent link="world"/><child link="base"/></joint>'
    model.write_text(model.read_text().replace('<link name="base"/>', f'<link name="base"/>{held}'))
    with pytest.raises(
        InputError, match=r"weld\[0\]\.body is 'base', which joint mount of the model joins to the world"
    ):
        Scene.load(path)
