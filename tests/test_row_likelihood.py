"""The likelihood of models by their whitened rows is that of the samples, whatever their laws make of these."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import expm

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.whitening.covariance import _volume
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.link import RotorInertia
from drake_cafim.numerics.row_products import SymmetricBand
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

INERTIA, PERIOD, SAMPLES = 0.1, 0.01, 400
Q_STD, V_STD = 1e-4, 1e-3
"""rad and rad/s."""


@pytest.mark.parametrize("density", [1e-7, 1e-5])
@pytest.mark.parametrize("stiff", [2.0, 20.0, 200.0])
def test_rows_compare_a_stiff_law_with_a_soft_one_as_the_samples_do(
    tmp_path: Path, stiff: float, density: float
) -> None:
    """A joint about rest under white forces, with frictions by which it forgets its velocity within 0.5 s, and sooner.

    Rows are fewer than samples, so that they tell the two apart less.
    """
    recording = _pushed(stiff, density)
    problem = prepare(_turntable(tmp_path), [recording]).problem()
    assert isinstance(problem, WeakProblem)
    by_rows, by_samples = [], []
    for coefficient in (0.2, stiff):
        model = problem.nominal().with_effects([JointViscousFriction("pan", {"coefficient": coefficient})])
        own = problem.with_unknown_force(np.array([density]), model)
        by_rows.append(float(np.sum(own.rows_of(model) ** 2)) + own.log_determinant)
        by_samples.append(_minus_twice_log_likelihood(recording, coefficient, density))
    assert by_samples[1] < by_samples[0]
    assert 0.5 < np.diff(by_rows)[0] / np.diff(by_samples)[0] < 1.1


def test_four_times_the_force_has_the_log_determinant_of_its_rows(tmp_path: Path) -> None:
    """Where unknown forces are nearly all of the noise, as beside exact encoders, ln det C rises by ln 4 a window.

    The volume that the rows make of the samples' noise is not changed by a force.
    """
    scene = _turntable(tmp_path, 1e-8, 1e-7)
    problem = prepare(scene, [_pushed(2.0, 1e-3)]).problem()
    assert isinstance(problem, WeakProblem)
    model, windows = problem.nominal(), len(problem.runs[0].weak.samples.windows)
    weak, strong = (problem.with_unknown_force(np.array([density]), model) for density in (1e-3, 4e-3))
    assert strong.log_determinant - weak.log_determinant == pytest.approx(windows * np.log(4.0), rel=0.01)


def test_rows_without_noise_make_no_volume() -> None:
    noise = SymmetricBand.of(sp.csr_matrix(np.diag([4.0, 0.0, 9.0])))
    assert _volume(noise) == pytest.approx(np.log(36.0))


def test_errors_of_measured_efforts_do_not_favour_a_larger_inertia(tmp_path: Path) -> None:
    """A joint follows its plan, and its torque sensor is off by five times what is stated.

    If these errors were forces, a joint of twice the inertia would move less under them, and predict its motion better.
    """
    random = np.random.default_rng(2)
    time = PERIOD * np.arange(SAMPLES)
    columns = {
        "q.pan": -0.1 * np.sin(2.0 * time) + 1e-6 * random.normal(size=SAMPLES),
        "v.pan": -0.2 * np.cos(2.0 * time) + 1e-5 * random.normal(size=SAMPLES),
        "u.pan": 0.4 * INERTIA * np.sin(2.0 * time) + 0.05 * random.normal(size=SAMPLES),
    }
    problem = prepare(_turntable(tmp_path, 1e-6, 1e-5, 0.01), [Recording("pan", time, columns)]).problem()
    assert isinstance(problem, WeakProblem)
    right = problem.nominal()
    costs = []
    for model in (right, right.with_effects([RotorInertia("pan", {"inertia": INERTIA})])):
        own = problem.with_unknown_force(problem.likeliest_force(model), model)
        costs.append(float(np.sum(own.rows_of(model) ** 2)) + own.log_determinant)
    assert costs[0] < costs[1] - 10.0


def _turntable(folder: Path, q_std: float = Q_STD, v_std: float = V_STD, u_std: float = 0.0) -> Scene:
    """One upright axis, whose channels have these standard deviations, rad, rad/s and N m."""
    (folder / "pan.urdf").write_text(
        '<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/><mass value="0.5"/>'
        f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>'
        "</robot>"
    )
    (folder / "pan.yaml").write_text(
        "model: pan.urdf\nweld: [{body: base}]\n"
        f"channels: {{q: {{std: {q_std}}}, v: {{std: {v_std}}}, u: {{std: {u_std}}}}}\n"
    )
    return Scene.load(folder / "pan.yaml")


def _discrete(coefficient: float, density: float) -> tuple[Array, Array]:
    """Transition and covariance by white forces of one sampling step (Van Loan, IEEE TAC 23(3), 1978)."""
    A, B = np.array([[0.0, 1.0], [0.0, -coefficient / INERTIA]]), np.array([0.0, 1.0 / INERTIA])
    joined = np.zeros((4, 4))
    joined[:2, :2], joined[:2, 2:], joined[2:, 2:] = -A, density * np.outer(B, B), A.T
    moved = expm(joined * PERIOD)
    transition = moved[2:, 2:].T
    return transition, transition @ moved[:2, 2:]


def _pushed(coefficient: float, density: float) -> Recording:
    """A recording of the joint under white forces, without an effort."""
    random = np.random.default_rng(1)
    transition, spread = _discrete(coefficient, density)
    time, root = PERIOD * np.arange(SAMPLES), np.linalg.cholesky(spread)
    state, states = np.zeros(2), []
    for _ in range(SAMPLES):
        states.append(state)
        state = transition @ state + root @ random.normal(size=2)
    q, v = np.array(states).T
    columns = {"q.pan": q + Q_STD * random.normal(size=SAMPLES), "v.pan": v + V_STD * random.normal(size=SAMPLES)}
    return Recording("pan", time, columns | {"u.pan": np.zeros(SAMPLES)})


def _minus_twice_log_likelihood(recording: Recording, coefficient: float, density: float) -> float:
    """That of all samples, but for a constant, by a Kalman filter from an unknown state."""
    transition, spread = _discrete(coefficient, density)
    noise = np.diag([Q_STD**2, V_STD**2])
    x, P, total = np.zeros(2), 1e2 * np.eye(2), 0.0
    for q, v in zip(recording["q.pan"], recording["v.pan"], strict=True):
        innovation, S = np.array([q, v]) - x, P + noise
        total += float(innovation @ np.linalg.solve(S, innovation)) + float(np.linalg.slogdet(S)[1])
        gained = P @ np.linalg.inv(S)
        x, P = x + gained @ innovation, P - gained @ P
        x, P = transition @ x, transition @ P @ transition.T + spread
    return total
