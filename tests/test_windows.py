"""The weak form's integrals over windows against exact integrals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.test_functions import lay_windows
from drake_cafim.numerics.local_polynomial import local_polynomial, track_polynomial
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.concealed.make import simulate


def _staircase_motion(time: np.ndarray, steps: np.ndarray, u: np.ndarray) -> np.ndarray:
    """p(t) with ṗ = u held from each of `steps` on, exactly."""
    edges = np.append(steps, np.inf)
    lengths = np.clip(time[:, None], edges[:-1], edges[1:]) - edges[:-1]
    return lengths @ u


def _grid(samples: int, jitter: float) -> np.ndarray:
    return 0.002 * (np.arange(samples) + jitter * np.random.default_rng(0).uniform(-0.5, 0.5, samples))


@pytest.mark.parametrize("jitter", [0.0, 0.5])
@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.0064])
def test_held_effort_balances_momentum(delay: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    time = _grid(500, jitter)
    u = rng.normal(size=500)
    p = _staircase_motion(time, time + delay, u)
    windows = lay_windows(time, np.ones(500, dtype=bool), 0.06)
    residual = -windows.rate @ p - windows.integrate_held(time + delay, u)
    plain = -windows.rate @ p - windows.value @ np.interp(time - delay, time, u)
    inside = windows.starts > 0.02
    assert np.abs(residual[inside]).max() < 1e-11 * np.abs(plain[inside]).max()


@pytest.mark.parametrize("jitter", [0.0, 0.5])
@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.0064])
def test_velocity_rows_know_that_acceleration_steps(delay: float, jitter: float) -> None:
    rng = np.random.default_rng(2)
    time = _grid(400, jitter)
    held = rng.normal(size=400)
    fine = np.unique(np.concatenate([time, time + delay]))
    h = np.diff(fine)
    at = np.searchsorted(time + delay, fine[:-1] + 1e-12, side="right") - 1
    a = np.where(at >= 0, held[np.maximum(at, 0)], 0.0)
    v = np.append(0.0, np.cumsum(h * a))
    q = np.append(0.0, np.cumsum(h * v[:-1] + 0.5 * h**2 * a))
    windows = lay_windows(time, np.ones(400, dtype=bool), 0.06)
    sampled = np.searchsorted(fine, time)
    plain = windows.rate @ q[sampled] + windows.velocity @ v[sampled]
    residual = plain - windows.correct_steps(time + delay, held)
    inside = windows.starts > 0.02
    assert np.abs(residual[inside]).max() < 1e-12 * np.abs(windows.velocity @ v[sampled]).max()


def test_windows_sum_to_one_and_their_slopes_to_zero() -> None:
    """What is not at the ends telescopes: constants and noise that lasts are not written by any ripple."""
    time = _grid(500, 0.5)
    windows = lay_windows(time, np.ones(500, dtype=bool), 0.12)
    inside = (time > time[0] + 0.12) & (time < time[-1] - 0.12 - windows.spacing)
    total = np.asarray(windows.interval.sum(axis=0)).ravel()
    np.testing.assert_allclose(total[inside[:-1]], 1.0, atol=1e-11)
    np.testing.assert_allclose(np.asarray(windows.rate.sum(axis=0)).ravel()[inside], 0.0, atol=1e-11)
    np.testing.assert_allclose(windows.rate @ np.ones(500), 0.0, atol=1e-11)


def test_a_smooth_motion_on_an_uneven_grid_is_consistent() -> None:
    time = _grid(400, 0.5)
    q, v = np.sin(9.0 * time), 9.0 * np.cos(9.0 * time)
    windows = lay_windows(time, np.ones(400, dtype=bool), 0.06)
    residual = windows.rate @ q + windows.value @ v
    assert np.abs(residual).max() < 1e-4 * np.abs(windows.value @ v).max()


def test_windows_avoid_gaps_and_missing_samples() -> None:
    time = np.concatenate([0.01 * np.arange(50), 1.0 + 0.01 * np.arange(50)])
    usable = np.ones(100, dtype=bool)
    usable[70] = False
    windows = lay_windows(time, usable, 0.1)
    for start in windows.starts:
        inside = (time >= start - 1e-9) & (time <= start + 0.1 + 1e-9)
        assert inside.sum() >= 10 and usable[inside].all()
        assert np.diff(time[inside]).max() < 0.011


def test_local_polynomial_is_exact_on_polynomials_even_on_an_uneven_grid() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(0.001 + 0.001 * rng.random(200))
    cubic = 1.0 + 2.0 * time - 30.0 * time**2 + 100.0 * time**3
    slope = 2.0 - 60.0 * time + 300.0 * time**2
    np.testing.assert_allclose(local_polynomial(time, 0.008, 3, 0) @ cubic, cubic, atol=1e-10)
    np.testing.assert_allclose(local_polynomial(time, 0.008, 3, 1) @ cubic, slope, atol=1e-7)


@pytest.mark.parametrize("jitter", [0.0, 0.5])
def test_local_polynomials_take_what_is_one_as_it_is(jitter: float) -> None:
    """At the ends, too, and in every derivative; positions and velocities together alike."""
    time = _grid(200, jitter)
    position = np.polynomial.Polynomial([0.3, -1.0, 4.0, 20.0, -60.0, 100.0, 300.0, -500.0])
    for derivative in range(3):
        found = local_polynomial(time, 0.02, 7, derivative) @ position(time)
        wanted = position.deriv(derivative)(time) if derivative else position(time)
        np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())
    for ratio in (0.0, 0.01):
        from_q, from_v = track_polynomial(time, 0.03, 7, ratio)
        together = from_q @ position(time) + from_v @ position.deriv()(time)
        np.testing.assert_allclose(together, position(time), atol=1e-10)


def test_fewer_samples_than_powers_are_fitted_as_they_are() -> None:
    time = _grid(4, 0.5)
    np.testing.assert_allclose(local_polynomial(time, 0.0, 6, 0) @ np.sin(100.0 * time), np.sin(100.0 * time))


def test_wider_windows_cover_what_the_narrow_ones_do(tmp_path: Path) -> None:
    """No sample that is missing, or too near to one."""
    simulate("null", "arm2", 11).write(tmp_path)
    recording = recordings.read(tmp_path / "train_1.parquet")
    q = f"q.{Scene.load(tmp_path / 'scenario.yaml').tree.joint_names[0]}"
    holes = np.where(
        (recording.time > recording.time[0] + 2.0) & (recording.time < recording.time[0] + 2.1), np.nan, recording[q]
    )
    prepared = prepare(
        Scene.load(tmp_path / "scenario.yaml"), [replace(recording, columns={**recording.columns, q: holes})]
    )
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    found = problem.over_wider_windows(4.0)
    assert found is not None
    wide, width = found
    narrow, wide_ones = (own.runs[0].weak.samples.windows for own in (problem, wide))
    assert width == wide_ones.width == pytest.approx(4.0 * narrow.width)
    touched, seen = (np.unique(own.value.indices) for own in (wide_ones, narrow))
    assert np.all(np.isin(touched, seen))
    assert not np.any(np.isnan(holes[touched]))
    # those of a recording of six seconds are too few where they are longer than it
    assert problem.over_wider_windows(100.0) is None


def test_a_short_recording_leaves_the_others_their_wider_windows(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path)
    long, short = (two_links.recording(f"run_{k}.parquet", k, duration=s) for k, s in ((1, 3.0), (2, 0.4)))
    prepared = prepare(scene, [long, short])
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    found, width = problem.over_wider_windows(4.0) or (problem, 0.0)
    assert [form.samples.windows.width for form in found.forms] == pytest.approx([0.48, 0.12])
    assert width == pytest.approx(0.48)
    assert problem.over_wider_windows(64.0) is None


@pytest.mark.parametrize("jitter", [0.0, 0.5])
@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.0064])
def test_ramped_effort_balances_momentum(delay: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    time = _grid(500, jitter)
    u = rng.normal(size=500)
    knots = time + delay
    slope = np.diff(u) / np.diff(knots)
    momenta = np.append(0.0, np.cumsum(0.5 * (u[1:] + u[:-1]) * np.diff(knots)))
    at = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, 498)
    since = time - knots[at]
    p = momenta[at] + u[at] * since + 0.5 * slope[at] * since**2
    windows = lay_windows(time, np.ones(500, dtype=bool), 0.06)
    ramped = -windows.rate @ p - windows.integrate_held(knots, u, ramped=True)
    held = -windows.rate @ p - windows.integrate_held(knots, u)
    inside = windows.starts > 0.02
    assert np.abs(ramped[inside]).max() < 1e-11 * np.abs(held[inside]).max()


@pytest.mark.parametrize("delay", [0.0, 0.0007])
def test_velocity_rows_know_that_acceleration_bends(delay: float) -> None:
    rng = np.random.default_rng(2)
    time = _grid(400, 0.3)
    asked, knots = rng.normal(size=400), time + delay
    fine = np.unique(np.concatenate([time, knots]))
    h, a = np.diff(fine), np.interp(fine, knots, asked)
    v = np.append(0.0, np.cumsum(0.5 * h * (a[:-1] + a[1:])))
    q = np.append(0.0, np.cumsum(h * v[:-1] + h**2 * (a[:-1] / 3.0 + a[1:] / 6.0)))
    windows = lay_windows(time, np.ones(400, dtype=bool), 0.06)
    sampled = np.searchsorted(fine, time)
    plain = windows.rate @ q[sampled] + windows.velocity @ v[sampled]
    residual = plain - windows.correct_steps(knots, asked, ramped=True)
    inside = windows.starts > 0.02
    assert np.abs(residual[inside]).max() < 1e-9 * np.abs(windows.velocity @ v[sampled]).max()


def test_local_polynomials_of_many_samples_are_computed_by_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.cumsum(np.random.default_rng(3).uniform(0.0008, 0.0012, 400))
    whole = local_polynomial(time, 0.02, 3, 1)
    monkeypatch.setattr("drake_cafim.numerics.local_polynomial.CACHED_SAMPLES", 0)
    monkeypatch.setattr("drake_cafim.numerics.local_polynomial.WEIGHTS_AT_ONCE", 500)
    parts = local_polynomial(time, 0.02, 3, 1)
    assert parts is not whole
    np.testing.assert_array_equal(parts.toarray(), whole.toarray())
