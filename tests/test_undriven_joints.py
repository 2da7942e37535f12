"""A joint that nothing drives needs no column of efforts, where the model says so."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from tests import two_links

LACKING = (
    r"there is no column u\.elbow; expected the effort at that joint, zeros where nothing drives it; it has time, q\."
)
URDF = two_links.MODEL
LIMIT = '<limit lower="-6" upper="6" effort="50" velocity="50"/>'
MOTOR = """<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
  <joint name="{}"/><actuator name="motor"/></transmission>"""
MJCF = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/><geom size=".1" pos="0 0 -.2"/>
  <body name="lower" pos="0 0 -.5"><joint name="elbow" axis="0 1 0"/><geom size=".1" pos="0 0 -.2"/></body></body>
  </worldbody><actuator><motor joint="shoulder"/></actuator></mujoco>"""
TENDON = MJCF.replace("<motor ", '<motor tendon="belt"/><motor ').replace(
    "<actuator>", '<tendon><fixed name="belt"><joint joint="elbow" coef="1"/></fixed></tendon><actuator>'
)


def _without_limit(joint: str) -> str:
    start = URDF.index(LIMIT, URDF.index(f'<joint name="{joint}"'))
    return URDF[:start] + LIMIT.replace("50", "0", 1) + URDF[start + len(LIMIT) :]


def _scene(path: Path) -> Scene:
    return Scene.from_model(path, channels={"q": 2e-4, "v": 2e-3}, weld=() if path.suffix == ".xml" else ["base"])


def _prepared(folder: Path, model: str) -> Prepared:
    """The arm by this model, of whose elbow no effort was recorded."""
    path = folder / ("arm.xml" if "mujoco" in model else "arm.urdf")
    path.write_text(model)
    made = two_links.recording("a", 1)
    kept = {name: values for name, values in made.columns.items() if name != "u.elbow"}
    found = prepare(_scene(path), [replace(made, columns=kept)])
    assert isinstance(found, Prepared)
    return found


@pytest.mark.parametrize(
    "model",
    [
        _without_limit("elbow"),
        URDF.replace(' effort="50"', "").replace("</robot>", MOTOR.format("shoulder") + "</robot>"),
        MJCF,
    ],
    ids=["no effort limit", "no transmission", "no actuator"],
)
def test_the_effort_is_zero_where_the_model_drives_other_joints_alone(tmp_path: Path, model: str) -> None:
    found = _prepared(tmp_path, model)
    [form] = found.weak
    assert np.all(form.samples.u[:, 1] == 0.0) and np.any(form.samples.u[:, 0] != 0.0)
    assert "u.elbow" not in found.effort_noise and form.samples.std["u.elbow"] == 0.0
    assert "no column u.elbow: by the model nothing drives elbow, whose effort is 0" in found.notes


@pytest.mark.parametrize(
    "model",
    [
        URDF,
        URDF.replace(LIMIT, LIMIT.replace("50", "0", 1)),
        URDF.replace("</robot>", MOTOR.format("elbow") + "</robot>"),
        TENDON,
    ],
    ids=["all have limits", "none has", "a motor there", "a tendon"],
)
def test_else_a_missing_column_is_an_error(tmp_path: Path, model: str) -> None:
    with pytest.raises(InputError, match=LACKING):
        _prepared(tmp_path, model)


def test_a_recorded_effort_of_such_a_joint_acts(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(_without_limit("elbow"))
    made = two_links.recording("a", 1)
    found = prepare(_scene(tmp_path / "arm.urdf"), [made])
    assert isinstance(found, Prepared)
    assert np.array_equal(found.weak[0].samples.u[:, 1], made.columns["u.elbow"])
