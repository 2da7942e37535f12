"""Columns by forces at one joint: their products are those of the whitened columns."""

import gc
import weakref
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.columns import Nuisance, change_by, products_of, whitened
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.screening import screen, solve_beside
from drake_cafim.diagnosis.joints.joint_force_columns import JointForceColumns
from drake_cafim.diagnosis.joints.linearised_effects import looks
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.pulses import Pulse, _pulse, force_information
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.whitening import force_information as module
from drake_cafim.diagnosis.whitening.force_information import PART, ForceInformation
from drake_cafim.effects.joint import JointCoulombFriction, JointForce, JointViscousFriction
from drake_cafim.effects.timing import SensorDelay
from tests import two_links

CHANNELS = (two_links.CHANNELS, "channels: {q: {std: 2.0e-4, correlation_time: 0.02}, v: {std: 2.0e-3}, u: {std: 0.1}}")


def _problem(folder: Path, channels: str) -> WeakProblem:
    """Two recordings of different lengths, of which the longer one has several times as many windows as are at once."""
    recordings = [two_links.recording("short", 1, duration=1.0), two_links.recording("long", 2, duration=6.0)]
    problem = prepare(two_links.scene(folder, channels), recordings).problem()
    assert isinstance(problem, WeakProblem)
    return problem


@pytest.mark.parametrize("channels", CHANNELS)
def test_products_are_those_of_whitened_columns(tmp_path: Path, channels: str) -> None:
    problem, rng = _problem(tmp_path, channels), np.random.default_rng(0)
    windows, nuisance_rows = sum(run.shape[0] for run in problem.runs), problem.rows + 1
    smooth = np.cumsum(rng.standard_normal((windows, 3)), axis=0)
    nuisance = Nuisance(np.linalg.qr(rng.standard_normal((nuisance_rows, 4)))[0], rng.standard_normal(nuisance_rows))
    for joint in (0, 1):
        columns = JointForceColumns(problem, joint, smooth)
        X = columns.whitened()
        assert X.shape == (problem.rows, 3)
        for found, expected in zip(columns.products(nuisance), products_of(X, nuisance), strict=True):
            assert np.allclose(found, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())
        b = np.array([1.0, -2.0, 0.5])
        assert np.allclose(change_by(columns, b), X @ b, rtol=1e-9, atol=1e-12 * np.abs(X).max())


def test_forces_that_diverge_are_no_candidate(tmp_path: Path) -> None:
    """Their squares are beyond what a number can hold, of which nothing is said on the terminal."""
    problem = _problem(tmp_path, two_links.CHANNELS)
    windows = sum(run.shape[0] for run in problem.runs)
    forces = np.column_stack([np.ones(windows), np.geomspace(1.0, 1e200, windows)])
    nuisance = Nuisance(np.zeros((problem.rows, 0)), np.ones(problem.rows))
    assert solve_beside(JointForceColumns(problem, 0, forces), nuisance) is None


def test_what_two_windows_share_is_that_of_the_inverse_covariance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full matrix is stored as such."""
    monkeypatch.setattr(module, "DENSE_SHARE", 2.0)
    problem = _problem(tmp_path, two_links.CHANNELS)
    run = problem.runs[1]
    rows = run.shape[1] * np.arange(run.shape[0]) + run.weak.dynamic.start + 1
    inverse = np.linalg.inv(run.whiten.covariance.full().toarray())[np.ix_(rows, rows)]
    found = force_information(problem, 1).at_joint[1]
    assert np.allclose(found.toarray(), inverse, atol=1e-6 * np.abs(inverse).max())  # type: ignore[union-attr]
    monkeypatch.setattr(module, "DENSE_SHARE", 0.0)
    whole = ForceInformation.of(run, 1).at_joint[1]
    assert isinstance(whole, np.ndarray)
    assert np.allclose(whole, inverse, atol=1e-6 * np.abs(inverse).max())


def test_a_pulse_at_all_joints_has_the_products_of_its_whitened_columns(tmp_path: Path) -> None:
    """Its windows lie in two of the parts that are whitened at once, near the start and up to the end."""
    problem = _problem(tmp_path, two_links.CHANNELS)
    run, information = problem.runs[1], force_information(problem, 1)
    rng, count = np.random.default_rng(0), len(information.near)
    assert count > 20
    for first, length in ((0, 1), (3, count), (PART - 5, 20), (run.shape[0] - count, count)):
        weights = rng.uniform(0.5, 1.0, length)
        columns = np.zeros((*run.shape, run.weak.joints))
        for joint in range(run.weak.joints):
            columns[first : first + length, run.weak.dynamic.start + joint, joint] = weights
        X = run.whitened(columns)
        np.testing.assert_allclose(information.of_pulse(first, weights), X.T @ X, rtol=1e-6)


def test_forces_that_rows_do_not_tell_apart_count_once_in_a_pulse(tmp_path: Path) -> None:
    """A pulse whose force at a joint is not felt is none."""
    run = _problem(tmp_path, two_links.CHANNELS).runs[0]
    alike = 4.0 * np.outer([1.0, 0.5], [1.0, 0.5])

    def found(products: np.ndarray) -> Pulse | None:
        information = SimpleNamespace(of_pulse=lambda first, weights: products)
        return _pulse(run, information, 0.2, 0.3, 2, 6)  # type: ignore[arg-type]

    once, both = found(alike), found(alike + np.eye(2))
    assert once is not None and once.scale.shape == (1, 2)
    # of a force along the first joint that moves the rows by K f
    force = np.array([1.0, 0.5])
    assert np.sum((once.scale @ (alike @ force)) ** 2) == pytest.approx(force @ alike @ force, rel=1e-9)
    assert both is not None and np.allclose(both.scale.T @ both.scale, np.linalg.inv(alike + np.eye(2)), rtol=1e-9)
    assert found(np.diag([1.0, 0.0])) is None


def test_a_problem_that_was_screened_is_freed_at_once(tmp_path: Path) -> None:
    """Its caches take hundreds of megabytes: nothing in them may refer to it."""
    problem = _problem(tmp_path, two_links.CHANNELS)
    fitted = fit(problem, problem.nominal())
    assert screen(problem, fitted, [effect for effect in problem.hypotheses() if isinstance(effect, JointForce)])
    assert problem.force_looks
    seen = weakref.ref(problem)
    gc.disable()
    try:
        del problem, fitted
        assert seen() is None
    finally:
        gc.enable()


def test_looks_that_are_kept_are_those_of_the_samples_as_corrected(tmp_path: Path) -> None:
    """A joint law looks elsewhere once a sensor is known to be late, and where it did once it no longer is."""
    problem = _problem(tmp_path, two_links.CHANNELS)
    delays = [SensorDelay(f"{kind}.shoulder", {"delay": 0.02}) for kind in "qv"]
    prompt, late = problem.nominal(), problem.nominal().with_effects(delays)

    def seen(model: Model, of: WeakProblem) -> np.ndarray:
        at = Fit(model, of.residual(model), of.jacobian(model), np.eye(len(model.vector)), of.rows)
        return np.concatenate(
            [whitened(columns) for columns, _ in looks(of, at, JointCoulombFriction("shoulder")).found], axis=1
        )

    first, second, third = (seen(model, problem) for model in (prompt, late, prompt))
    np.testing.assert_array_equal(first, third)
    np.testing.assert_array_equal(second, seen(late, _problem(tmp_path, two_links.CHANNELS)))
    assert np.linalg.norm(second - first) > 0.01 * np.linalg.norm(first)


def test_a_force_is_tried_along_the_slope_that_it_has_in_a_fit(tmp_path: Path) -> None:
    problem = _problem(tmp_path, two_links.CHANNELS)
    viscous = JointViscousFriction("shoulder", {"coefficient": 0.1})
    model = problem.nominal().with_effects([viscous])
    at = Fit(model, problem.residual(model), problem.jacobian(model), np.eye(len(model.vector)), problem.rows)
    [(columns, _)] = looks(problem, at, viscous).found
    slope = problem.effect_columns(model, 0)[: problem.rows]
    assert np.allclose(whitened(columns), slope, atol=1e-9 * np.abs(slope).max())
