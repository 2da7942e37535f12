"""Forces within a model's accuracy count as noise as far as the rows show them."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.adjustment import adjust
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.diagnosis.whitening.unmodelled_force import _asked, _weighed
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.numerics.row_products import lower_entries
from drake_cafim.scene.scene import Scene
from tests import long_recording, two_links
from tests.long_recording import Long


@pytest.mark.long
def test_slow_rows_of_a_right_model_hold_all_of_their_noise(tmp_path: Path) -> None:
    """With the smoother's forces as noise, slow rows hold three quarters of it."""
    address = long_recording.write(Long(3, 40.0, rate=500.0, friction=0.0, seed=3), tmp_path)
    scene = Scene.load(address)
    prepared = prepare(scene, [recordings.read(tmp_path / "log.parquet")])
    problem, fitted = fit_given(prepared.problem(), Model(scene.priors.mean))
    assert isinstance(problem, WeakProblem)
    rows = fitted.residual[: problem.rows].reshape(problem.runs[0].shape)
    power = np.abs(np.fft.rfft(rows, axis=0)) ** 2 / len(rows)
    slow = power[1 : len(power) // 12]
    assert abs(np.mean(slow) - 1.0) < 3.0 / np.sqrt(slow.size)


@pytest.mark.parametrize("density", [0.0, 1e-6])
def test_the_density_that_rows_ask_for_is_the_one_that_they_have(tmp_path: Path, density: float) -> None:
    prepared = prepare(two_links.scene(tmp_path), [two_links.recording("log", 1, duration=2.0)])
    problem = prepared.problem()
    assert isinstance(problem, WeakProblem)
    physics = problem.under.physics(problem.scene)
    weak = adjust(problem.forms[0], physics)
    run = Run(weak, *whitening(weak, physics))
    weighed, rng, found = _weighed(weak, physics), np.random.default_rng(4), []
    shares = [lower_entries(part @ part.T) for part in weighed]
    for _ in range(20):
        noise = run.whiten.unwhiten(rng.standard_normal((run.rows, 1)))[:, 0]
        rows = noise + np.sqrt(density) * (weighed[1] @ rng.standard_normal(weighed[1].shape[1]))
        found.append(_asked(run, rows, weighed, shares, np.full(2, 1.0))[1])
    if density:
        assert np.mean(found) == pytest.approx(density, rel=0.2)
    else:
        # half of them ask for none, and the others for a little
        assert 4 <= sum(own == 0.0 for own in found) <= 16 and np.mean(found) < 2e-9
