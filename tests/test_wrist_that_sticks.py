"""A light wrist whose model states large frictions, as public descriptions do: nothing is missing in its recordings.

Each joint's acceleration depends on what holds the others at rest, and their friction is large beside their inertia.
"""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.judgement import judge
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.descriptions.hidden import Hidden
from tests.descriptions.mujoco_robot import Robot, specification
from tests.descriptions.recorded import NAMES, NOISE_Q, NOISE_V, record, within_limits

LINK = """<link name="{name}"><inertial><origin xyz="0 {side} 0.05"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 0.1" rpy="{tilt} 0 0"/>
<axis xyz="{axis}"/><limit lower="-{reach}" upper="{reach}" effort="50" velocity="20"/>
<dynamics damping="{damping}" friction="1"/></joint>"""


@pytest.fixture(scope="module")
def wrist(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    path: Path = tmp_path_factory.mktemp("wrist") / "wrist.urdf"
    links = [LINK.format(name=name, side=side, mass=mass, i=i) for name, side, mass, i in (
        ("forearm", 0.05, 1.0, 2e-2), ("hand", 0.06, 0.6, 1e-3), ("flange", 0.0, 0.1, 5e-5),
    )]  # fmt: skip
    joints = [JOINT.format(name=name, parent=a, child=b, axis=axis, reach=reach, damping=damping, tilt=tilt)
        for name, a, b, axis, reach, damping, tilt in (
            ("roll", "base", "forearm", "0 0 1", 2, 1, 0), ("bend", "forearm", "hand", "1 0 0", 0.4, 2, 0.7),
            ("turn", "hand", "flange", "0 0 1", 2, 2, 0),
    )]  # fmt: skip
    path.write_text(f'<robot name="wrist"><link name="base"/>{"".join(links)}{"".join(joints)}</robot>')
    scene = Scene.from_model(path, channels={"q": NOISE_Q[0], "v": NOISE_V[0], "u": 0.0}, weld=["base"])
    robot = Robot.of(specification(scene, path), scene)
    rng, sliding = np.random.default_rng(4), np.zeros(3, dtype=bool)
    limits = np.array([joint.position_limits for joint in scene.tree.joints])
    wanted = within_limits(rng, robot, limits, sliding, np.full(3, np.inf))
    tables = record(rng, robot, robot, wanted, Hidden(), sliding)
    return scene, [
        Recording(name, table["time"].to_numpy(), {c: table[c].to_numpy() for c in table if c != "time"})
        for name, table in tables.items() if name != NAMES[-1]
    ]  # fmt: skip


def test_what_is_left_is_noise_at_every_joint(wrist: tuple[Scene, list[Recording]]) -> None:
    problem = prepare(*wrist).problem()
    rows = np.concatenate([own for _, own in by_run(problem, problem.residual(problem.nominal())[: problem.rows])])
    assert np.all(np.mean(rows**2, axis=0) < 1.5)


def test_nothing_is_missing(wrist: tuple[Scene, list[Recording]]) -> None:
    assert judge(prepare(*wrist).problem(), Settings(), lambda text: None).kind == "none"
