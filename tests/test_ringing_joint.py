"""A joint that rings behind a soft gear: between two samples its link's acceleration changes, and the rows count it."""

from pathlib import Path

import numpy as np
import pandas as pd
import scipy.linalg

from drake_cafim import recordings
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.scene.scene import Scene

ROTOR, LINK, STIFFNESS, DAMPING = 0.05, 0.12, 280.0, 0.2
URDF = f"""
<robot name="turntable" xmlns:drake="http://drake.mit.edu">
  <link name="base"/>
  <link name="plate">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{LINK}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="axis" type="continuous"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/></joint>
  <transmission name="drive">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="axis"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="motor"><drake:rotor_inertia value="{ROTOR}"/><drake:gear_ratio value="1"/></actuator>
  </transmission>
</robot>
"""
SCENARIO = """
model: turntable.urdf
weld: [{body: base}]
channels: {q: {std: 1.0e-5}, v: {std: 1.0e-3}, u: {std: 0.0}}
"""


def _ringing(step: float, seconds: float) -> pd.DataFrame:
    """Exact samples of q, v of the link, from rest, under a held effort that jumps ten times a second."""
    # state (θ, θ̇, q, q̇) and the held effort
    pull, drag = STIFFNESS, DAMPING
    A = np.zeros((5, 5))
    A[0, 1] = A[2, 3] = 1.0
    A[1] = [-pull / ROTOR, -drag / ROTOR, pull / ROTOR, drag / ROTOR, 1.0 / ROTOR]
    A[3] = [pull / LINK, drag / LINK, -pull / LINK, -drag / LINK, 0.0]
    advance = scipy.linalg.expm(A * step)
    time = np.arange(0.0, seconds, step)
    levels = np.random.default_rng(7).normal(0.0, 2.0, int(np.ceil(10.0 * seconds)) + 1)
    effort = np.where(time < 0.1, 0.0, levels[(10.0 * time + 1e-6).astype(int)])
    x, rows = np.zeros(4), []
    for u in effort:
        rows.append((x[2], x[3]))
        x = (advance @ np.append(x, u))[:4]
    q, v = np.array(rows).T
    return pd.DataFrame({"time": time, "q.axis": q, "v.axis": v, "u.axis": effort})


def test_exact_samples_of_a_ringing_joint_leave_nothing(tmp_path: Path) -> None:
    (tmp_path / "turntable.urdf").write_text(URDF)
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    _ringing(0.002, 4.0).to_parquet(tmp_path / "exact.parquet")
    scene = Scene.load(tmp_path / "scenario.yaml")
    problem = prepare(scene, [recordings.read(tmp_path / "exact.parquet")]).problem()
    truth = problem.nominal().with_effects([JointElasticity("axis", {"stiffness": STIFFNESS, "damping": DAMPING})])
    rows = problem.rewhitened(truth).residual(truth)
    # the stated noise would make it 1; without the change between samples it is 1.5
    assert float(np.mean(rows**2)) < 0.01
