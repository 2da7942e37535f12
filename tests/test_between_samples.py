"""What moves within a sample interval: a link that rings behind a soft gear, and one that damping stops at once."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.linalg

from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.typing import Array
from tests.turntable import problem_of, write_turntable

ROTOR, LINK, STIFFNESS, DAMPING = 0.05, 0.12, 280.0, 0.2
WRIST = 4e-4
"""kg m², of a light wrist."""


def _exact(A: Array, effort: Array, step: float, shown: tuple[int, int]) -> pd.DataFrame:
    """Exact samples of ẋ = A [x; u] from rest under a held effort; q and v are the states `shown`."""
    n = A.shape[0]
    whole = np.zeros((n + 1, n + 1))
    whole[:n] = A
    advance, x, rows = scipy.linalg.expm(whole * step), np.zeros(n), []
    for u in effort:
        rows.append(x[list(shown)])
        x = (advance @ np.append(x, u))[:n]
    q, v = np.array(rows).T
    return pd.DataFrame({"time": step * np.arange(len(effort)), "q.axis": q, "v.axis": v, "u.axis": effort})


def test_exact_samples_of_a_ringing_joint_leave_nothing(tmp_path: Path) -> None:
    """Of rotor and link under an effort that jumps ten times a second."""
    A = np.zeros((4, 5))
    A[0, 1] = A[2, 3] = 1.0
    A[1] = np.array([-STIFFNESS, -DAMPING, STIFFNESS, DAMPING, 1.0]) / ROTOR
    A[3] = np.array([STIFFNESS, DAMPING, -STIFFNESS, -DAMPING, 0.0]) / LINK
    time = np.arange(0.0, 4.0, 0.002)
    levels = np.random.default_rng(7).normal(0.0, 2.0, 41)
    effort = np.where(time < 0.1, 0.0, levels[(10.0 * time + 1e-6).astype(int)])
    write_turntable(tmp_path, _exact(A, effort, 0.002, (2, 3)), (1e-5, 1e-3), LINK, rotor=ROTOR)
    problem = problem_of(tmp_path)
    truth = problem.nominal().with_effects([JointElasticity("axis", {"stiffness": STIFFNESS, "damping": DAMPING})])
    rows = problem.rewhitened(truth).residual(truth)
    # the stated noise would make it 1; without the change between samples it is 1.5
    assert float(np.mean(rows**2)) < 0.01


@pytest.mark.parametrize(("damping", "most"), [(0.01, 1e-6), (0.1, 1e-6), (0.4, 0.02)])
def test_exact_samples_of_a_damped_joint_leave_nothing(tmp_path: Path, damping: float, most: float) -> None:
    """Its velocity relaxes in 40, 4 and 1 ms, and the effort jumps every 4 ms."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, -damping / WRIST, 1.0 / WRIST]])
    time = np.arange(0.0, 4.0, 0.004)
    effort = 0.04 * np.sin(2.0 * np.pi * 0.7 * time) + 0.005 * np.random.default_rng(1).normal(size=time.size)
    write_turntable(tmp_path, _exact(A, effort, 0.004, (0, 1)), (2e-4, 2e-3), WRIST, damping=damping)
    problem = problem_of(tmp_path)
    # 1.1 at .1 N m s/rad with the velocities' cubics in place of the motion between samples
    assert float(np.mean(problem.residual(problem.nominal()) ** 2)) < most


WRIST_ARM = """
<robot name="wrist">
  <link name="base"/>
  <link name="hand">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="tip">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="roll" type="continuous">
    <parent link="base"/><child link="hand"/><axis xyz="0 0 1"/><dynamics damping="1" friction="1"/>
  </joint>
  <joint name="twist" type="continuous">
    <parent link="hand"/><child link="tip"/><axis xyz="0 0 1"/><dynamics damping="1" friction="1"/>
  </joint>
</robot>
"""


def test_light_joints_with_the_friction_of_large_ones_are_estimated_by_their_samples(tmp_path: Path) -> None:
    """Two coaxial joints of a wrist whose model states 1 N m and 1 N m s/rad, as makers do for all joints alike.

    Each moves the other, and their velocities relax in a tenth of a millisecond: estimated joint by joint, the motion
    would leave the samples.
    """
    (tmp_path / "wrist.urdf").write_text(WRIST_ARM)
    channels = "{q: {std: 1.0e-4}, u: {std: 0.03, hold: first_order}}"
    (tmp_path / "scenario.yaml").write_text(f"model: wrist.urdf\nweld: [{{body: base}}]\nchannels: {channels}\n")
    rng, time = np.random.default_rng(3), np.arange(0.0, 6.0, 0.01)
    table = {"time": time}
    moves = [(0.5, 1.7, 0.3), (0.4, 2.9, 1.1)]
    v = [size * rate * np.cos(rate * time + phase) for size, rate, phase in moves]
    a = [-size * rate**2 * np.sin(rate * time + phase) for size, rate, phase in moves]
    forces = [3e-4 * a[0] + 1e-4 * a[1], 1e-4 * (a[0] + a[1])]
    for name, (size, rate, phase), velocity, force in zip(("roll", "twist"), moves, v, forces, strict=True):
        table[f"q.{name}"] = size * np.sin(rate * time + phase) + rng.normal(0.0, 1e-4, time.size)
        effort = force + velocity + np.tanh(velocity / 0.005)
        table[f"u.{name}"] = effort + rng.normal(0.0, 0.03, time.size)
    pd.DataFrame(table).to_parquet(tmp_path / "run.parquet")
    problem = problem_of(tmp_path)
    assert float(np.mean(problem.residual(problem.nominal()) ** 2)) < 2.0
