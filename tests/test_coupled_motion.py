"""Light joints that move each other and relax together within a sample interval, under stated viscous friction."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.linalg

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.noise.coloured import Memory
from drake_cafim.diagnosis.rows.coupled_motion import relax_together
from drake_cafim.numerics.kalman import StateSpace
from drake_cafim.numerics.relaxation import Relaxation
from drake_cafim.scene.scene import Scene
from tests.turntable import problem_of

INERTIA = np.array([[3e-4, 1e-4], [1e-4, 1e-4]])
"""kg m², the mass matrix of the wrist: two coaxial joints, so that it is constant."""
Q_STD, V_STD = 2e-4, 2e-3


def _wrist(folder: Path, damping: float, correlation_time: float = 0.0) -> None:
    (folder / "wrist.urdf").write_text(f"""
<robot name="wrist">
  <link name="base"/>
  <link name="hand">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="tip">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="roll" type="continuous">
    <parent link="base"/><child link="hand"/><axis xyz="0 0 1"/><dynamics damping="{damping}"/>
  </joint>
  <joint name="twist" type="continuous">
    <parent link="hand"/><child link="tip"/><axis xyz="0 0 1"/><dynamics damping="{damping}"/>
  </joint>
</robot>
""")
    v = f"{{std: {V_STD}, correlation_time: {correlation_time}}}" if correlation_time else f"{{std: {V_STD}}}"
    channels = f"{{q: {{std: {Q_STD}}}, v: {v}, u: {{std: 0.0}}}}"
    (folder / "scenario.yaml").write_text(f"model: wrist.urdf\nweld: [{{body: base}}]\nchannels: {channels}\n")


def _record(
    folder: Path, damping: float, step: float, actual: float, correlation_time: float = 0.0, rotors: float = 0.0
) -> None:
    """Exact samples, with noise, of the wrist under the `actual` damping and held efforts that carry noise too.

    The noise of velocities is white, or correlated by exp(−t/`correlation_time`). `rotors` kg m² turn with each joint.
    """
    rng, time = np.random.default_rng(5), np.arange(0.0, 4.0, step)
    wanted = np.stack([np.sin(2.0 * np.pi * rate * time) for rate in (0.7, 1.1)], axis=1)
    effort = damping * (wanted + 0.05 * rng.normal(size=wanted.shape))
    mobility = np.linalg.inv(INERTIA + rotors * np.eye(2))
    whole = np.zeros((6, 6))
    whole[:2, 2:4], whole[2:4, 2:4], whole[2:4, 4:] = np.eye(2), -actual * mobility, mobility
    advance, x, rows = scipy.linalg.expm(whole * step), np.zeros(4), []
    for u in effort:
        rows.append(x)
        x = (advance @ np.concatenate([x, u]))[:4]
    q, v = np.split(np.array(rows), 2, axis=1)
    table = {"time": time}
    for j, name in enumerate(("roll", "twist")):
        table[f"q.{name}"] = q[:, j] + rng.normal(0.0, Q_STD, time.size)
        noise = Memory(correlation_time).drawn(rng, time) if correlation_time else rng.normal(size=time.size)
        table[f"v.{name}"] = v[:, j] + V_STD * noise
        table[f"u.{name}"] = effort[:, j]
    pd.DataFrame(table).to_parquet(folder / "run.parquet")


@pytest.mark.parametrize(("damping", "step"), [(0.1, 0.002), (0.1, 0.01), (0.3, 0.004), (1.0, 0.002), (1.0, 0.01)])
def test_joints_that_relax_together_leave_noise_alone(tmp_path: Path, damping: float, step: float) -> None:
    """Rates are 300 to 20000 1/s, sampled at 100 to 500 Hz; one joint at a time, more than noise remains."""
    _wrist(tmp_path, damping)
    _record(tmp_path, damping, step, damping)
    problem = problem_of(tmp_path)
    rows = problem.residual(problem.nominal())
    assert float(np.mean(rows**2)) < 1.0 + 4.0 * np.sqrt(2.0 / len(rows))


def test_more_friction_than_stated_shows(tmp_path: Path) -> None:
    _wrist(tmp_path, 0.3)
    _record(tmp_path, 0.3, 0.004, 0.36)
    problem = problem_of(tmp_path)
    assert float(np.mean(problem.residual(problem.nominal()) ** 2)) > 10.0


def test_joints_without_viscous_friction_are_estimated_one_by_one(tmp_path: Path) -> None:
    _wrist(tmp_path, 0.0)
    _record(tmp_path, 0.3, 0.004, 0.3)
    problem = problem_of(tmp_path)
    physics = problem.nominal().physics(problem.scene)
    assert not relax_together(problem.runs[0].weak, physics)


def test_links_far_lighter_than_what_turns_do_not_follow_each_step_of_their_efforts(tmp_path: Path) -> None:
    """Positions and velocities agree, whatever the model lacks; by its motion the one seemed half a sample late."""
    _wrist(tmp_path, 0.3)
    _record(tmp_path, 0.3, 0.004, 0.3, rotors=0.02)
    problem = problem_of(tmp_path)
    assert relax_together(problem.runs[0].weak, problem.nominal().physics(problem.scene))
    [run] = problem.runs
    rows = problem.apart(problem.rows_of(problem.nominal()))
    of_kind = np.mean(rows.reshape(run.shape) ** 2, axis=0)
    assert np.all(of_kind[:2] < 1.2) and np.all(of_kind[2:] > 100.0)
    # laws are evaluated along a motion that is as near to the samples as their noise
    read = pd.read_parquet(tmp_path / "run.parquet")
    for column, std in (("q.roll", Q_STD), ("v.roll", V_STD), ("q.twist", Q_STD), ("v.twist", V_STD)):
        left = run.weak.samples.recording[column] - read[column].to_numpy()
        assert np.mean((left / std) ** 2) < 1.0


def _with_gain(folder: Path, gain: float) -> None:
    """Records velocities of the first joint that are too large by `gain`."""
    table = pd.read_parquet(folder / "run.parquet")
    table["v.roll"] *= gain
    table.to_parquet(folder / "run.parquet")


@pytest.mark.parametrize("correlation_time", [0.0, 0.003])
def test_rows_change_with_a_sensor_as_their_slopes_say(tmp_path: Path, correlation_time: float) -> None:
    """The motion is estimated anew from what the sensor says; noise that is correlated in time is no part of it.

    It was: a velocity 2 % too large then was the joint's own, and changed the rows by a fifteenth of their slope.
    """
    _wrist(tmp_path, 0.3, correlation_time)
    _record(tmp_path, 0.3, 0.004, 0.3, correlation_time)
    right = problem_of(tmp_path)
    _with_gain(tmp_path, 1.02)
    wrong, physics, own = problem_of(tmp_path), right.nominal().physics(right.scene), right.runs[0]
    change = own.whitened(wrong.runs[0].noisy_rows(physics) - own.noisy_rows(physics))
    gain = next(effect for effect in right.hypotheses() if effect.key == ("sensor_gain_error", "v.roll"))
    slope = -0.02 * right.sensor_columns(gain)[:, 0]
    assert np.linalg.norm(slope) > 10.0
    assert float(change @ slope) == pytest.approx(float(slope @ slope), rel=0.02)
    assert np.linalg.norm(change - slope) < 0.15 * np.linalg.norm(slope)


@pytest.mark.parametrize("correlation_time", [0.0, 0.003])
def test_a_velocity_sensor_is_told_as_wrong_as_it_is(tmp_path: Path, correlation_time: float) -> None:
    _wrist(tmp_path, 0.3, correlation_time)
    _record(tmp_path, 0.3, 0.004, 0.3, correlation_time)
    _with_gain(tmp_path, 1.02)
    found = diagnose(Scene.load(tmp_path / "scenario.yaml"), [recordings.read(tmp_path / "run.parquet")])
    assert [it.effect.key for it in found.explanation] == [("sensor_gain_error", "v.roll")]
    gain = found.explanation[0].values["gain"]
    assert gain.value == pytest.approx(1.02, abs=4.0 * gain.std) and gain.std < 2e-3


@pytest.mark.parametrize("damping", [1e-6, 1e-3, 0.1, 10.0])
def test_relaxation_is_that_of_the_matrix_exponential(damping: float) -> None:
    """Of two coupled joints, and of a third one without friction, with all inputs as states."""
    whole, h, n = np.eye(3), 0.004, 3
    whole[:2, :2] = INERTIA / 3e-4
    mobility, friction = np.linalg.inv(3e-4 * whole), np.array([damping, 0.3 * damping, 0.0])
    found = Relaxation.of(mobility[None], friction[None], np.array([h]))
    # time in intervals: v′ = −x v + a + s Δa, s′ = 1, q′ = v
    A = np.zeros((4 * n, 4 * n))
    A[:n, :n], A[:n, n : 2 * n] = -h * mobility * friction, np.eye(n)
    A[n : 2 * n, 2 * n : 3 * n], A[3 * n :, :n] = np.eye(n), np.eye(n)
    exact = scipy.linalg.expm(A)
    for part, row, column in [
        (found.left, 0, 0),
        (found.first, 0, 1),
        (found.second, 0, 2),
        (found.first, 3, 0),
        (found.second, 3, 1),
        (found.third, 3, 2),
    ]:
        block = exact[row * n : (row + 1) * n, column * n : (column + 1) * n]
        np.testing.assert_allclose(part[0], block, atol=1e-9)


def test_smoothed_states_are_those_of_all_samples_together() -> None:
    """By direct inversion of the covariance of two coupled states under forces, a sample missing; and its stds."""
    rng, N, m = np.random.default_rng(2), 8, 2
    steps = np.stack([np.array([[0.9, 0.2], [-0.1, 0.7]]) + 0.05 * rng.normal(size=(m, m)) for _ in range(N - 1)])
    entering, rise = rng.normal(size=(N - 1, m, 1)), rng.normal(size=(N - 1, m))
    fresh, start = np.tile(0.1 * np.eye(m), (N - 1, 1, 1)), np.diag([2.0, 3.0])
    variance, read = np.full((N, m), 0.3), rng.normal(size=(N, m))
    variance[3, 1] = np.inf
    forces = rng.uniform(0.5, 2.0, size=(N - 1, 1))
    anew, told = np.arange(N) == 0, np.array([[1.0, 0.0], [0.3, -0.7], [0.0, 1.0]])
    found = StateSpace(read, variance, np.eye(m), told, steps, rise, entering, fresh, start, anew).smooth(forces)
    mean, covariance = [np.zeros(m)], np.zeros((N * m, N * m))
    covariance[:m, :m] = start
    for k, (F, G) in enumerate(zip(steps, entering, strict=True)):
        old, new = slice(0, (k + 1) * m), slice((k + 1) * m, (k + 2) * m)
        mean.append(F @ mean[-1] + rise[k])
        covariance[new, old] = F @ covariance[k * m : (k + 1) * m, old]
        covariance[old, new] = covariance[new, old].T
        own = F @ covariance[k * m : (k + 1) * m, k * m : (k + 1) * m] @ F.T
        covariance[new, new] = own + G @ np.diag(forces[k]) @ G.T + fresh[k]
    seen = np.isfinite(variance).ravel()
    noisy = covariance[np.ix_(seen, seen)] + np.diag(variance.ravel()[seen])
    gain = np.linalg.solve(noisy, covariance[seen]).T
    expected = np.concatenate(mean) + gain @ (read.ravel() - np.concatenate(mean))[seen]
    whole = np.kron(np.eye(N), told)
    np.testing.assert_allclose(found.mean.ravel(), whole @ expected, atol=1e-10)
    left = np.diagonal(whole @ (covariance - gain @ covariance[seen]) @ whole.T)
    np.testing.assert_allclose(found.std.ravel(), np.sqrt(left), atol=1e-10)
