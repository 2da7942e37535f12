"""Friction laws are told apart by their forces near rest: a sign change of any width is still Coulomb's."""

import math
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import parse
from drake_cafim.scene.scene import Scene

MODEL = """<robot name="slider"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/></joint>
</robot>"""
STEP, FINE, TORQUE = 0.002, 200, 3.0
STD = {"q": 2e-6, "v": 1e-3}


def _recording(name: str, width: float, seed: int) -> Recording:
    """A block that is pushed to and fro over dry friction, by steps of a hundredth of a millisecond."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(2000)
    u = 6.0 * np.sin(2.0 * np.pi * 0.7 * time + seed) + 1.5 * np.sin(2.0 * np.pi * 1.7 * time)
    q, v = np.zeros(len(time)), np.zeros(len(time))
    h = STEP / FINE
    for k in range(len(time) - 1):
        x, rate, effort = float(q[k]), float(v[k]), float(u[k])
        for _ in range(FINE):
            half = rate + 0.5 * h * (effort - TORQUE * math.tanh(rate / width)) / 2.0
            x, rate = x + h * half, rate + h * (effort - TORQUE * math.tanh(half / width)) / 2.0
        q[k + 1], v[k + 1] = x, rate
    noisy = {"q.rail": q + STD["q"] * rng.normal(size=len(q)), "v.rail": v + STD["v"] * rng.normal(size=len(v))}
    return Recording(name, time, noisy | {"u.rail": u})


@pytest.mark.long
@pytest.mark.parametrize("width", [0.0025, 0.009])
def test_a_sign_change_of_any_width_is_coulombs(tmp_path: Path, width: float) -> None:
    """Widths between those that are tried first; the velocity is known no better than the sign change is wide."""
    (tmp_path / "slider.urdf").write_text(MODEL)
    raw = {"model": "slider.urdf", "weld": [{"body": "base"}], "channels": {k: {"std": std} for k, std in STD.items()},
           "unknown": [{"parameter": "mass", "body": "block", "mean": 2.0, "std": 0.2}]}  # fmt: skip
    scene = Scene.build(parse(raw, "test"), tmp_path, "test")
    verdict = diagnose(scene, [_recording("a", width, 1), _recording("b", width, 2)])
    assert [accepted.effect.name for accepted in verdict.explanation] == ["joint_coulomb_friction"]
    found = verdict.explanation[0].values["torque"]
    assert abs(found.value - TORQUE) < 4.0 * found.std
    assert found.std < 0.01
