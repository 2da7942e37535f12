"""The likelihood of whole recordings: against dense linear algebra, closed forms and motions that swing over."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.likelihood.efficiency import bounds, efficiencies
from drake_cafim.diagnosis.likelihood.linearised import Linearised
from drake_cafim.diagnosis.likelihood.whole_recordings import WholeFit, fit_whole
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.report.wording import as_well
from tests.benchmarks.efficiency.cell import Cell, moved, recorded, scene_of
from tests.benchmarks.peers.task import record
from tests.benchmarks.peers.tasks import TASKS
from tests.benchmarks.peers.tools import recording_of, scene_with_priors
from tests.test_efficiency_bench import TINY, closed_form


def _random_system(rng: np.random.Generator, forced: bool) -> Linearised:
    N, s, m, p, w = 6, 3, 2, 2, 1
    return Linearised(
        A=np.eye(s) + 0.3 * rng.normal(size=(N - 1, s, s)),
        B=rng.normal(size=(N - 1, s, p)),
        c=rng.normal(size=(N - 1, s)),
        E=0.5 * forced * rng.normal(size=(N - 1, s, w)),
        C=rng.normal(size=(N, m, s)),
        D=rng.normal(size=(N, m, p)),
        r=rng.normal(size=(N, m)),
        R=np.array([0.1, 0.4]),
        seen=rng.random((N, m)) < 0.8,
        start=np.array([3.0, 2.0, 5.0]),
    )


def _dense(item: Linearised) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Information, gradient, and states as X₀ + X₁ θ, by one large generalised least squares problem."""
    N, m, s = item.C.shape
    p, w = item.D.shape[2], item.E.shape[2]
    # every state is linear in (x of the first sample, noises, θ, 1)
    free = s + w * (N - 1)
    maps = np.zeros((N, s, free + p + 1))
    maps[0, :, :s] = np.eye(s)
    for k in range(N - 1):
        maps[k + 1] = item.A[k] @ maps[k]
        maps[k + 1, :, s + w * k : s + w * (k + 1)] += item.E[k]
        maps[k + 1, :, free : free + p] += item.B[k]
        maps[k + 1, :, -1] += item.c[k]
    rows = np.einsum("kms,ksf->kmf", item.C, maps)
    rows[:, :, free : free + p] += item.D
    rows = rows[item.seen]
    weights = np.sqrt(np.broadcast_to(item.R, (N, m))[item.seen])
    J, readings = rows[:, :-1] / weights[:, None], (item.r[item.seen] - rows[:, -1]) / weights
    prior = np.diag(np.concatenate([1.0 / item.start, np.ones(free - s), np.zeros(p)]))
    whole, side = J.T @ J + prior, J.T @ readings
    own = np.linalg.solve(whole[:free, :free], np.column_stack([whole[:free, free:], side[:free]]))
    information = whole[free:, free:] - whole[free:, :free] @ own[:, :p]
    gradient = side[free:] - whole[free:, :free] @ own[:, p]
    still = np.einsum("ksf,f->ks", maps[:, :, :free], own[:, p]) + maps[:, :, -1]
    moving = maps[:, :, free:-1] - np.einsum("ksf,fp->ksp", maps[:, :, :free], own[:, :p])
    return information, gradient, still, moving


@pytest.mark.parametrize("forced", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_smoother_solves_the_dense_problem(seed: int, forced: bool) -> None:
    item = _random_system(np.random.default_rng(seed), forced)
    information, gradient, still, moving = _dense(item)
    np.testing.assert_allclose(item.filtered.information, information, atol=1e-9)
    np.testing.assert_allclose(item.filtered.gradient, gradient, atol=1e-9)
    theta = np.array([0.3, -1.2])
    np.testing.assert_allclose(item.deviations(theta), still + moving @ theta, atol=1e-8)


def _prepared(cell: Cell, folder: Path, number: int = 0) -> tuple[Prepared, Model]:
    scene = scene_of(cell, folder)
    prepared = prepare(scene, recorded(cell, moved(cell)[0], number))
    assert isinstance(prepared, Prepared)
    return prepared, Model(np.array([2.2]), (JointViscousFriction("rail", {"coefficient": 0.5}),))


def test_the_bound_of_a_report_is_the_closed_form(tmp_path: Path) -> None:
    prepared, true = _prepared(TINY, tmp_path)
    found = bounds(prepared.scene, prepared.weak, true)
    expected = np.sqrt(np.diag(closed_form(TINY)))
    # it is linearised along what was recorded, noise included
    np.testing.assert_allclose(found, expected, rtol=0.03)
    np.testing.assert_allclose(efficiencies(expected, 2.0 * expected), 0.25)


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_bound_is_of_all_recordings(tmp_path: Path, jobs: int) -> None:
    prepared, true = _prepared(TINY, tmp_path)
    scene = prepared.scene
    prior = np.append(1.0 / scene.priors.std**2, 0.0)
    once = np.asarray(bounds(scene, prepared.weak, true))
    twice = np.asarray(bounds(scene, [*prepared.weak, *prepared.weak], true, jobs=jobs))
    # of one unknown and one strength; what the recordings tell of each alone is doubled, to within the prior
    assert np.all(prior * once**2 < 0.05)
    np.testing.assert_allclose(once / twice, np.sqrt(2.0), rtol=0.03)


def test_estimates_reach_the_bound_and_claim_no_more(tmp_path: Path) -> None:
    expected, off = np.sqrt(np.diag(closed_form(TINY))), []
    for number in range(40):
        prepared, true = _prepared(TINY, tmp_path, number)
        found = fit_whole(prepared.scene, prepared.weak, true.at(np.array([1.8, 0.2])))
        assert isinstance(found, WholeFit) and found.settled
        np.testing.assert_allclose(found.std, expected, rtol=0.05)
        off.append((found.model.vector - [2.2, 0.5]) / expected)
    # 40 draws: χ² of 40 is between 20 and 67 in 98 of 100 cases
    assert np.all(np.sum(np.square(off), axis=0) < 67.0), np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(np.sum(np.square(off), axis=0) > 20.0)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "duration"), [(0, 3.0), (1, 5.0)])
def test_an_arm_that_swings_over_is_found_from_the_prior(seed: int, duration: float) -> None:
    task = replace(next(task for task in TASKS if task.name == "swing-over"), duration=duration)
    once, scene = record(task, seed), scene_with_priors(task)
    assert np.ptp(once.q[:, 1]) > 2.0 * np.pi
    prepared = prepare(scene, [recording_of(task, once)])
    assert isinstance(prepared, Prepared)
    found = fit_whole(prepared.scene, prepared.weak, Model(scene.priors.mean))
    assert isinstance(found, WholeFit) and found.settled
    # the engine's dry friction is not quite ours: a per cent or two, from starts that are 38 to 80 % off
    assert np.all(np.abs(found.model.unknown / task.true - 1.0) < 0.05), found.model.unknown / task.true


def test_efficiency_in_words() -> None:
    assert as_well(0.97) == "as well as these recordings can tell"
    assert as_well(0.25) == "these recordings could tell it 2.0 times as closely"
    assert as_well(4.0) == "surer than these recordings can tell"
    assert as_well(None) == as_well(float("nan")) == ""
