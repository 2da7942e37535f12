"""A joint that goes beyond the limits that its model states: a stop's forces are there, which the model has not."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

DOOR = """<robot name="door"><link name="base"/><link name="leaf"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="leaf"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.8" effort="50" velocity="20"/></joint></robot>"""


def _notes(folder: Path, turned: float) -> list[str]:
    (folder / "door.urdf").write_text(DOOR, encoding="utf-8")
    scene = Scene.from_model(folder / "door.urdf", channels={"q": 1e-4, "v": 1e-3, "u": 0.0}, weld=["base"])
    time = 0.002 * np.arange(2000)
    q = turned * np.sin(2.0 * np.pi * 0.5 * time)
    v, a = np.gradient(q, time), np.gradient(np.gradient(q, time), time)
    rng = np.random.default_rng(1)
    columns = {
        "q.hinge": q + rng.normal(0.0, 1e-4, len(q)),
        "v.hinge": v + rng.normal(0.0, 1e-3, len(q)),
        "u.hinge": 0.1 * a,
    }
    return [note for note in prepare(scene, [Recording("swing", time, columns)]).notes if "limit" in note]


@pytest.mark.parametrize("turned", [0.3, 0.5])
def test_within_the_limits_nothing_is_noted(tmp_path: Path, turned: float) -> None:
    assert not _notes(tmp_path, turned)


def test_beyond_one_limit_it_is_named_with_how_far_and_how_often(tmp_path: Path) -> None:
    # a sine of 0.7 is beyond 0.5 for (π − 2 arcsin(5/7))/(2π) of the time
    [note] = _notes(tmp_path, 0.7)
    assert "hinge goes 0.2 rad beyond the limit -0.5 rad that the model states, 24.7 % of the time" in note


def test_beyond_both_each_is_named(tmp_path: Path) -> None:
    assert ["-0.5 rad" in note for note in _notes(tmp_path, 1.0)] == [True, False]
