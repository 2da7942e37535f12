"""Columns by forces at one joint: their products are those of the whitened columns."""

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.columns import Nuisance, change_by, products_of
from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.joints.joint_force_columns import JointForceColumns, inverse_at
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.joint import JointForce
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


def test_what_two_windows_share_is_that_of_the_inverse_covariance(tmp_path: Path) -> None:
    problem = _problem(tmp_path, two_links.CHANNELS)
    run = problem.runs[1]
    rows = run.shape[1] * np.arange(run.shape[0]) + run.weak.dynamic.start + 1
    inverse = np.linalg.inv(run.whiten.covariance.toarray())[np.ix_(rows, rows)]
    assert np.allclose(inverse_at(problem, 1, 1).toarray(), inverse, atol=1e-6 * np.abs(inverse).max())


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
