"""MJCF bodies that weigh what their meshes do: as MuJoCo has them, or one sentence where it is not installed."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from drake_cafim.dynamics.motion import mass_matrix, motion
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene

WEDGE = "0 0 0  0.3 0 0  0 0.2 0  0 0 0.1  0.3 0.2 0.05"
INERTIAL = '<inertial pos="0.1 0 0" mass="7" diaginertia="0.1 0.1 0.1"/>'
MODEL = """<mujoco model="wedge">
  <compiler inertiafromgeom="{rule}"/>
  <default><default class="light"><geom type="mesh" density="500"/></default></default>
  <asset><mesh name="wedge" vertex="{vertex}"/></asset>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0"/>{inertial}
      <geom class="light" mesh="wedge" pos="0.1 0 0" euler="0 20 40"/><geom size="0.05" pos="0.2 0 0"/>
      <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 0.6 0.8"/>
        <geom type="mesh" mesh="wedge" mass="0.7"/></body>
    </body>
  </worldbody>
</mujoco>"""


def _written(folder: Path, rule: str = "auto", inertial: str = "") -> Path:
    path = folder / "wedge.xml"
    path.write_text(MODEL.format(vertex=WEDGE, rule=rule, inertial=inertial), encoding="utf-8")
    return path


@pytest.mark.parametrize(("rule", "inertial"), [("auto", ""), ("auto", INERTIAL), ("true", INERTIAL)])
def test_bodies_weigh_what_their_meshes_do(tmp_path: Path, rule: str, inertial: str) -> None:
    path = _written(tmp_path, rule, inertial)
    scene = Scene.from_model(str(path))
    q = np.array([0.3, -0.7])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    expected = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, expected)
    [M] = mass_matrix(motion(scene.tree, q[None], np.zeros((1, 2))))
    np.testing.assert_allclose(M, expected, rtol=1e-6)


def test_without_mujoco_the_body_and_both_ways_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"wedge.xml, line 6: body 'upper' .*an <inertial>.*pip install mujoco"):
        Scene.from_model(str(_written(tmp_path)))


def test_a_mesh_that_is_not_there_is_told(tmp_path: Path) -> None:
    path = _written(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace(f'vertex="{WEDGE}"', 'file="gone.stl"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"line 6: body 'upper' .*gone.stl.*expected an <inertial>"):
        Scene.from_model(str(path))


def test_a_body_without_a_name_is_asked_for_one(tmp_path: Path) -> None:
    path = _written(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace('name="lower" ', ""), encoding="utf-8")
    with pytest.raises(InputError, match=r"line 8: body 'body_2' .*expected a name or an <inertial>$"):
        Scene.from_model(str(path))
