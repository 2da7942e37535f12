"""Unknown forces that last for longer than a window: how they are told from white ones, and what they leave."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.joints import unknown_force
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.diagnosis.search import search_under_unknown_force
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.search_under_unknown_force import _count_lasting_forces
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.whitening.covariance import _mean_of_neighbours
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed.noise import ChannelNoise
from tests.concealed_case import written

STD, LASTING = 0.05, 0.03
"""N m, and the time constant of the correlation, s."""


def _shaken(recording: Recording, joint: str, seed: int, lasting: float) -> Recording:
    """A recording whose efforts at `joint` leave out random ones that last; or white ones of the same density."""
    time = recording.time
    rng, step = np.random.default_rng(seed), float(np.median(np.diff(time)))
    # of an exponential correlation, the density at low frequencies is 2 τ σ²
    std = STD if lasting else STD * float(np.sqrt(2.0 * LASTING / step))
    hidden = ChannelNoise(std, lasting).draw(rng, time[None], 1)[0, :, 0]
    return replace(recording, columns={**recording.columns, f"u.{joint}": recording[f"u.{joint}"] - hidden})


@pytest.fixture(scope="module", params=[LASTING, 0.0], ids=["lasting", "white"])
def shaken(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[WeakProblem, bool]:
    """An arm that lacks nothing, whose first joint is shaken; and whether the forces last."""
    scene, read = written(simulate("null", "arm2", 11), tmp_path_factory.mktemp("arm"))
    joint = scene.tree.joint_names[0]
    problem = prepare(scene, [_shaken(run, joint, seed, request.param) for seed, run in enumerate(read)]).problem()
    assert isinstance(problem, WeakProblem)
    return problem, bool(request.param)


def test_they_leave_white_noise_where_they_are_counted_as_such(shaken: tuple[WeakProblem, bool]) -> None:
    problem, lasts = shaken
    nominal = unbiased_fit(problem, problem.nominal())
    assert problem.forced_joints == ()
    white = problem.likeliest_force(nominal.model)
    found = problem.likeliest_force(nominal.model, lasting=True)
    assert white.shape == (2,)
    under_white = problem.with_unknown_force(white, nominal.model)
    assert leaves_noise(under_white, unbiased_fit(under_white, nominal.model), 0.01) == (not lasts)
    if not lasts:
        np.testing.assert_array_equal(found, white)
        return
    density = found.reshape(2, 2).sum(axis=0)
    assert density[0] == pytest.approx(2.0 * LASTING * STD**2, rel=0.3)
    assert found[2] > 0.5 * density[0] and density[1] < 1e-3 * density[0]
    own = problem.with_unknown_force(found, nominal.model)
    assert leaves_noise(own, unbiased_fit(own, nominal.model), 0.01)
    # a start from nearby ends there, too
    again = problem.likeliest_force(nominal.model, own, lasting=True)
    np.testing.assert_allclose(again.reshape(2, 2).sum(axis=0)[0], density[0], rtol=0.05)
    assert own.forced_joints == (problem.scene.tree.joint_names[0],)
    [remark] = own.force_remarks
    assert "last, with a mean over 0.12 s of" in remark and own.forced_joints[0] in remark


@pytest.mark.parametrize("rests", [False, True])
def test_a_joint_is_exact_where_as_large_a_force_would_show(
    shaken: tuple[WeakProblem, bool], rests: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _ = shaken
    first, second = problem.scene.tree.joint_names
    assert problem.exact_joints == (), "nothing stands out anywhere"
    nominal = problem.nominal()
    own = problem.with_unknown_force(problem.likeliest_force(nominal), nominal)
    efforts = unknown_force._mean_square_efforts(own)
    assert np.all(efforts > 0.0)
    # hardly any effort: a force in proportion to it could not be seen
    monkeypatch.setattr(unknown_force, "_mean_square_efforts", lambda of: efforts * [1.0, 1e-12 if rests else 1.0])
    assert own.forced_joints == (first,) and own.exact_joints == (() if rests else (second,))


@pytest.mark.parametrize("noise", [True, False])
def test_a_search_counts_them_as_noise_where_noise_is_then_left(
    shaken: tuple[WeakProblem, bool], noise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, lasts = shaken
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    under_white, refused = growth.problem, growth.refused
    if not noise:
        monkeypatch.setattr(search_under_unknown_force, "leaves_noise", lambda *of: False)
    _count_lasting_forces(growth, grows=False)
    assert growth.lasting == (lasts and noise)
    assert (growth.problem is under_white) == (not growth.lasting) == (growth.refused is refused)
    assert [(record.step, record.passed) for record in growth.trace.records] == ([("whiten", noise)] if lasts else [])


def test_the_scores_are_the_slopes_of_the_likelihood(shaken: tuple[WeakProblem, bool]) -> None:
    """By white and lasting forces, by central differences of −½ (ln det C + zᵀC⁻¹z)."""
    problem, _ = shaken
    run = problem.runs[0]
    physics = problem.nominal().physics(problem.scene)
    noise, factors = (
        unknown_force.row_covariance(run.weak, physics),
        unknown_force.unknown_force_factors(run.weak, physics),
    )
    rows = run.noisy_rows(physics).ravel()
    recording = unknown_force._Recording(rows, np.zeros((len(rows), 0)), noise, factors)
    density = np.array([1e-4, 1e-6, 5e-5, 1e-6])

    def likelihood(values: Array) -> float:
        whitened = recording.whitened(values)
        return -0.5 * float(whitened.rows @ whitened.rows) - float(np.sum(np.log(whitened.whiten.factor.diagonal)))

    score, information = recording.whitened(density).score(np.zeros(0))
    for k, value in enumerate(density):
        step = 1e-3 * value * np.eye(4)[k]
        slope = (likelihood(density + step) - likelihood(density - step)) / (2e-3 * value)
        assert score[k] == pytest.approx(slope, rel=0.02, abs=0.02 * float(np.sqrt(information[k % 2, k // 2, k // 2])))
    assert np.all(np.linalg.eigvalsh(information) > 0.0)


def test_kinds_of_forces_that_cannot_be_told_apart_are_one() -> None:
    """As over windows without neighbours: whatever rounding makes of the scores."""
    alike = np.array([[2.0, 2.0], [2.0, 2.0 + 1e-12]])
    assert not unknown_force._stands_out(np.array([1.0, 1.0 + 1e-3]), alike)
    apart = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert unknown_force._stands_out(np.array([0.0, 5.0]), apart)
    assert not unknown_force._stands_out(np.array([0.0, 4.8]), apart), "1.225 standard deviations are 1"
    assert not unknown_force._stands_out(np.array([0.0, -9.0]), apart), "a force of less than nothing"


@pytest.mark.parametrize("lasting", [False, True])
def test_what_is_noise_only_beside_forces_that_last_is_not_explained(
    shaken: tuple[WeakProblem, bool], lasting: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _ = shaken
    under = problem.with_unknown_force(np.full(4 if lasting else 2, 1e-4), problem.nominal())
    assert under.forces_last == lasting and not problem.forces_last
    nominal = unbiased_fit(problem, problem.nominal())
    outcome: Any = SimpleNamespace(problem=under, nominal_problem=problem, best=nominal)
    monkeypatch.setattr(search_under_unknown_force, "_excess", lambda of, found: 0.0)
    monkeypatch.setattr(search_under_unknown_force, "leaves_noise", lambda *of: True)
    trace = Trace()
    assert search_under_unknown_force.is_explained(outcome, nominal, Settings(), trace) == (not lasting)
    assert [record.passed for record in trace.records if record.step == "unknown_forces"] == [True, False][
        : 1 + lasting
    ]


def test_windows_of_two_runs_are_no_neighbours() -> None:
    samples = np.linspace(0.0, 1.0, 101)
    first = np.array([0, 0, 0, 50, 50])
    windows = Windows(samples, samples[first], 0.1, first, first + 10, first, first + 50)
    mean = _mean_of_neighbours(windows).toarray()
    np.testing.assert_allclose(mean.sum(axis=1), 1.0)
    assert mean[2, 3] == mean[3, 2] == 0.0 and mean[1, 0] == mean[1, 2] == 0.25
