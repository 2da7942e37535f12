"""Models that Drake's parser refuses as they are: repaired with a note, or refused by joint and line."""

from pathlib import Path

import pytest

from drake_cafim.errors import InputError
from tests.test_descriptions import arm, scene_of


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("arm.urdf", arm('<dynamics damping="-0.2" friction="0.1"/>')),
        (
            "arm.sdf",
            """<sdf version="1.9"><model name="arm"><link name="link2"/><joint name="elbow" type="revolute">
            <parent>world</parent><child>link2</child><axis><xyz>0 1 0</xyz><dynamics><damping>-0.2</damping></dynamics>
            </axis></joint></model></sdf>""",
        ),
        (
            "arm.xml",
            """<mujoco><worldbody><body><joint name="elbow" damping="-0.2"/><geom size="0.1"/></body></worldbody>
            </mujoco>""",
        ),
    ],
)
def test_a_damping_that_drives_is_left_out_and_noted(tmp_path: Path, name: str, text: str) -> None:
    scene = scene_of(tmp_path, text, name)
    assert scene.tree.joints[-1].damping == 0.0
    [said] = [note for note in scene.stated.notes if "damping" in note]
    assert name in said and "'elbow' has the damping -0.2" in said and "0 is used" in said


def test_limits_the_wrong_way_round_name_the_joint_and_the_line(tmp_path: Path) -> None:
    text = arm().replace('lower="-3.1415926535" upper="3.1415926535"', 'lower="1.2" upper="-0.5"', 1)
    with pytest.raises(InputError, match=r"arm.urdf, line 18: joint 'shoulder' has the limits 1.2 to -0.5, expected"):
        scene_of(tmp_path, text)


def test_bodies_without_gravity_are_told_once_with_the_remedy(tmp_path: Path) -> None:
    body = '<body name="{}" gravcomp="1"><joint name="{}"/><geom size="0.1"/>{}</body>'
    inner = body.format("lower", "elbow", "")
    text = f"<mujoco><worldbody>{body.format('upper', 'shoulder', inner)}</worldbody></mujoco>"
    [said] = [note for note in scene_of(tmp_path, text, "arm.xml").stated.notes if "gravcomp" in note]
    assert "upper, lower" in said and "`gravity: [0, 0, 0]`" in said


def test_actuators_may_share_a_name(tmp_path: Path) -> None:
    simple = """<transmission name="t{0}"><type>transmission_interface/SimpleTransmission</type><joint name="{0}"/>
      <actuator name="motor"/></transmission>"""
    text = arm().replace("</robot>", simple.format("shoulder") + simple.format("elbow") + "</robot>")
    assert [joint.effort_limit for joint in scene_of(tmp_path, text).tree.joints] == [10.0, 10.0]
