"""Unknown white forces at the joints as noise: their densities, where they show, and where none does."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.joints import unknown_force
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

DENSITY = 1.5e-4
"""(N m)² s"""


def _shaken(recording: Recording, joint: str, seed: int) -> Recording:
    """A recording whose efforts at `joint` leave out random ones, anew at each sample."""
    step = float(np.median(np.diff(recording.time)))
    hidden = np.sqrt(DENSITY / step) * np.random.default_rng(seed).normal(size=len(recording.time))
    return replace(recording, columns={**recording.columns, f"u.{joint}": recording[f"u.{joint}"] - hidden})


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> WeakProblem:
    """An arm that lacks nothing, whose first joint is shaken."""
    scene, read = written(simulate("null", "arm2", 11), tmp_path_factory.mktemp("arm"))
    joint = scene.tree.joint_names[0]
    problem = prepare(scene, [_shaken(run, joint, seed) for seed, run in enumerate(read)]).problem()
    assert isinstance(problem, WeakProblem)
    return problem


def test_they_leave_noise_where_they_are_counted_as_such(shaken: WeakProblem) -> None:
    nominal = unbiased_fit(shaken, shaken.nominal())
    assert shaken.forced_joints == ()
    found = shaken.likeliest_force(nominal.model)
    assert found.shape == (2,)
    assert found[0] == pytest.approx(DENSITY, rel=0.3) and found[1] < 1e-3 * found[0]
    assert not leaves_noise(shaken, nominal, 0.01)
    own = shaken.with_unknown_force(found, nominal.model)
    assert leaves_noise(own, unbiased_fit(own, nominal.model), 0.01)
    # a start from nearby ends there, too
    again = shaken.likeliest_force(nominal.model, own)
    assert again[0] == pytest.approx(found[0], rel=0.05)
    assert own.forced_joints == (shaken.scene.tree.joint_names[0],)
    [remark] = own.force_remarks
    assert "act like white noise over 0.12 s, of" in remark and own.forced_joints[0] in remark


@pytest.mark.parametrize("rests", [False, True])
def test_a_joint_is_exact_where_as_large_a_force_would_show(
    shaken: WeakProblem, rests: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = shaken.scene.tree.joint_names
    assert shaken.exact_joints == (), "nothing stands out anywhere"
    nominal = shaken.nominal()
    own = shaken.with_unknown_force(shaken.likeliest_force(nominal), nominal)
    efforts = unknown_force._mean_square_efforts(own)
    assert np.all(efforts > 0.0)
    # hardly any effort: a force in proportion to it could not be seen
    monkeypatch.setattr(unknown_force, "_mean_square_efforts", lambda of: efforts * [1.0, 1e-12 if rests else 1.0])
    assert own.forced_joints == (first,) and own.exact_joints == (() if rests else (second,))


def test_the_scores_are_the_slopes_of_the_likelihood(shaken: WeakProblem) -> None:
    """By central differences of −½ (ln det C + zᵀC⁻¹z)."""
    run = shaken.runs[0]
    physics = shaken.nominal().physics(shaken.scene)
    noise, factors = (
        unknown_force.row_covariance(run.weak, physics),
        unknown_force.unknown_force_factors(run.weak, physics),
    )
    rows = run.noisy_rows(physics).ravel()
    recording = unknown_force._Recording(rows, np.zeros((len(rows), 0)), noise, factors)
    density = np.array([1e-4, 1e-6])

    def likelihood(values: Array) -> float:
        whitened = recording.whitened(values)
        return -0.5 * float(whitened.rows @ whitened.rows) - float(np.sum(np.log(whitened.whiten.factor.diagonal)))

    score, information = recording.whitened(density).score(np.zeros(0))
    for k, value in enumerate(density):
        step = 1e-3 * value * np.eye(2)[k]
        slope = (likelihood(density + step) - likelihood(density - step)) / (2e-3 * value)
        assert score[k] == pytest.approx(slope, rel=0.02, abs=0.02 * float(np.sqrt(information[k])))
    assert np.all(information > 0.0)
