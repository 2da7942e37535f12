"""A joint that dry friction holds: no law of the velocity says with what force, and that is no missing physics."""

import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.sparse as sp

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.search.judgement import judge
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import REST_LASTING
from drake_cafim.diagnosis.whitening import lasting_noise
from drake_cafim.diagnosis.whitening.friction_at_rest import friction_at_rest_covariance
from tests.turntable import problem_of, write_turntable

INERTIA, FRICTION = 0.01, 0.05


def _held_and_let_go(seconds: float) -> pd.DataFrame:
    """A plate under a slow effort that the friction holds for most of the time, by exact pieces."""
    step, parts = 0.002, 200
    time = np.arange(0.0, seconds, step)
    effort = 0.06 * np.sin(2.0 * np.pi * 0.5 * time)
    q = v = 0.0
    rows = []
    for u in effort:
        rows.append((q, v))
        for _ in range(parts):
            h = step / parts
            free = v + h * u / INERTIA
            slowed = free - np.sign(free) * min(abs(free), h * FRICTION / INERTIA)
            q, v = q + 0.5 * h * (v + slowed), slowed
    q_read, v_read = np.array(rows).T
    rng = np.random.default_rng(4)
    table = {"q.axis": q_read + rng.normal(0.0, 1e-5, time.size), "v.axis": v_read + rng.normal(0.0, 1e-3, time.size)}
    return pd.DataFrame({"time": time, **table, "u.axis": effort})


def _problem(folder: Path) -> WeakProblem:
    write_turntable(folder, _held_and_let_go(6.0), (1e-5, 1e-3), INERTIA, friction=FRICTION)
    return problem_of(folder)


def test_what_holds_a_joint_is_noise_while_it_rests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = _problem(tmp_path)
    left = [float(np.mean(problem.residual(problem.nominal()) ** 2))]
    nothing = "drake_cafim.diagnosis.whitening.covariance.friction_at_rest_covariance"
    monkeypatch.setattr(nothing, lambda weak, physics: sp.csr_matrix(friction_at_rest_covariance(weak, physics).shape))
    bare = _problem(tmp_path)
    left.append(float(np.mean(bare.residual(bare.nominal()) ** 2)))
    assert left[0] < 2.0 and left[1] > 10.0


def test_a_width_that_is_stated_leaves_doubt_only_where_noise_hides_the_sign(tmp_path: Path) -> None:
    """The velocity's standard deviation is 1.7e-4 rad/s: a width of 3e-4 may as well be none, one of .005 is seen."""
    problem = _problem(tmp_path)
    (form,), physics = problem.forms, problem.scene.physics
    (friction,) = physics.joint_forces
    doubt = []
    for width in (None, 3e-4, 0.005):
        stated = {} if width is None else {"slip_velocity": width}
        changed = physics.changed(joint_forces=(type(friction)(friction.at, {**friction.values, **stated}),))
        doubt.append(float(np.max(friction_at_rest_covariance(form, changed).diagonal())))
    assert doubt[2] < 1e-4 * doubt[0] and 0.3 * doubt[0] < doubt[1] < 1.1 * doubt[0]


def test_what_holds_a_joint_may_turn_from_one_window_to_the_next(tmp_path: Path) -> None:
    """A joint at rest without an effort, as other joints shake it: half of what holds it is not what held it before."""
    time = np.arange(0.0, 2.0, 0.002)
    still = {f"{channel}.axis": np.zeros_like(time) for channel in "qvu"}
    write_turntable(tmp_path, pd.DataFrame({"time": time, **still}), (1e-5, 1e-3), INERTIA, friction=FRICTION)
    problem = problem_of(tmp_path)
    held = friction_at_rest_covariance(problem.forms[0], problem.scene.physics).toarray()
    rows = np.flatnonzero(np.diag(held) > 0.5 * np.max(held))
    # four windows on, a tenth of a second later
    assert held[rows[10], rows[14]] / held[rows[10], rows[10]] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("at_once", [1, 2, 2000])
def test_the_force_of_a_resting_joint_lasts(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(lasting_noise, "INSTANTS_AT_ONCE", at_once)
    time = np.array([0.0, 0.5, 1.4])
    expected = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.1], [0.0, 0.1, 1.0]])
    rows = sp.csr_matrix(np.array([[2.0, 0.0, 0.0], [0.0, 1.0, -3.0]]))
    np.testing.assert_allclose(
        lasting_noise.lasting(rows, time, REST_LASTING).toarray(), rows @ expected @ rows.T, atol=1e-12
    )


def test_a_minute_at_rest_takes_no_memory_for_each_pair_of_samples() -> None:
    time = 1e-3 * np.arange(6e4)
    rows = sp.csr_matrix((np.full(len(time), 1e-3), (np.arange(len(time)) // 30, np.arange(len(time)))))
    tracemalloc.start()
    covariance = lasting_noise.lasting(rows, time, REST_LASTING)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # pairs of samples within a second of each other would take 1.4 GB
    assert peak < 3e8
    assert covariance.diagonal()[100] == pytest.approx(0.03**2, rel=0.02)


def test_efforts_that_turn_within_a_window_move_no_resting_joint(tmp_path: Path) -> None:
    """A controller that makes up for the friction turns the effort round; neither that nor its gain is seen at rest."""
    step, inertia, friction = 0.002, 0.01, 0.05
    time = np.arange(0.0, 6.0, step)
    effort = 0.9 * friction * np.sign(np.sin(2.0 * np.pi * 1.3 * time))
    rng = np.random.default_rng(5)
    read = {"q.axis": rng.normal(0.0, 1e-5, time.size), "v.axis": rng.normal(0.0, 1e-3, time.size), "u.axis": effort}
    write_turntable(tmp_path, pd.DataFrame({"time": time, **read}), (1e-5, 1e-3), inertia, friction=friction)
    problem = problem_of(tmp_path)
    assert np.mean(problem.residual(problem.nominal()) ** 2) < 1.2
    assert judge(problem, Settings(), lambda text: None).kind == "none"
