"""A joint that is held still follows its sensors' noise: no late sensor is told where none is."""

from pathlib import Path
from typing import cast

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints import sensor_columns
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.sensor_columns import fed_back
from drake_cafim.diagnosis.noise.fed_back import fed_back_motion, feedback_gains
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.sensor_slopes import SensorSlopes
from drake_cafim.diagnosis.search.search import fit_nominal
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

STEP, INERTIA, NOISE_Q, NOISE_V = 0.002, 0.05, 2e-5, 4e-3
STIFFNESS, DAMPING = 2.0, 0.8
ROD = """
<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>
  <inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
  <limit lower="-9" upper="9" effort="100" velocity="100"/></joint></robot>
"""


def held(
    seed: int, noisy: bool = True, delay: int = 0, sway: float = 0.0, lag: int = 0
) -> tuple[Array, dict[str, Array]]:
    """A rod that a controller holds by what its sensors show, `noisy` or exact, swayed by `sway` rad.

    The recorded velocity is `delay` samples late, and its noise lasts for five; efforts follow after `lag` samples.
    """
    rng, N = np.random.default_rng(seed), 3000
    keep = np.exp(-1.0 / 5.0)
    noise_q, noise_v = NOISE_Q * rng.standard_normal(N), np.zeros(N)
    for k in range(1, N):
        noise_v[k] = keep * noise_v[k - 1] + NOISE_V * np.sqrt(1.0 - keep**2) * rng.standard_normal()
    q, v, u = np.zeros(N), np.zeros(N), np.zeros(N)
    for k in range(N):
        read = k - lag
        wanted = sway * np.sin(5.0 * STEP * k)
        if read >= 0:
            error = wanted - q[read] - noisy * noise_q[read]
            u[k] = STIFFNESS * error - DAMPING * (v[max(read - delay, 0)] + noisy * noise_v[read])
        if k < N - 1:
            v[k + 1] = v[k] + STEP * u[k] / INERTIA
            q[k + 1] = q[k] + 0.5 * STEP * (v[k] + v[k + 1])
    shown = v[np.maximum(np.arange(N) - delay, 0)]
    found = {"q.pivot": q + noise_q, "v.pivot": shown + noise_v, "u.pivot": u}
    return STEP * np.arange(N), found | {"e_q": noise_q, "e_v": noise_v, "q": q, "v": v}


def problem_of(folder: Path, columns: str = "qvu", **case: float) -> tuple[SearchProblem, Fit]:
    """Three recordings of a rod that is `held` so, with these kinds of columns, and the nominal fit."""
    (folder / "rod.urdf").write_text(ROD)
    velocity = f"  v: {{std: {NOISE_V}, correlation_time: {5 * STEP}}}\n" if "v" in columns else ""
    (folder / "scenario.yaml").write_text(
        "model: rod.urdf\ngravity: [0, 0, -9.81]\nweld: [{body: base}]\nchannels:\n"
        f"  q: {{std: {NOISE_Q}}}\n{velocity}  u: {{std: 0.0, hold: zero_order}}\n"
    )
    recordings = []
    for seed in range(3):
        time, found = held(seed, **case)  # type: ignore[arg-type]
        shown = {f"{kind}.pivot": found[f"{kind}.pivot"] for kind in columns}
        recordings.append(Recording(f"{seed}.parquet", time, shown))
    return fit_nominal(prepare(Scene.load(folder / "scenario.yaml"), recordings).problem(), Trace())


def late_gain(folder: Path, **case: float) -> float:
    """The decrease of χ² by a delay of the velocity, to first order, of three recordings."""
    problem, nominal = problem_of(folder, **case)
    return sum(look.gain for look in screen(problem, nominal, [effect_named("sensor_delay")("v.pivot")]))


def test_feedback_of_noise_is_found_by_what_is_rough() -> None:
    for noisy in (True, False):
        _, found = held(1, noisy=noisy, sway=0.3)
        gains = feedback_gains(*(found[f"{kind}.pivot"][:, None] for kind in "uqv"))
        if noisy:
            assert gains[0, 0] == pytest.approx([STIFFNESS, DAMPING], rel=0.05)
            assert np.all(np.abs(gains[0, 1]) < 0.05)
        else:
            assert not np.any(gains)


def test_efforts_that_are_not_recorded_follow_nothing() -> None:
    _, found = held(1)
    assert not np.any(feedback_gains(np.zeros((3000, 1)), found["q.pivot"][:, None], found["v.pivot"][:, None]))


@pytest.mark.parametrize("lag", [0, 1])
def test_what_a_controller_makes_of_noise_is_what_the_noise_changes(lag: int) -> None:
    time, noisy = held(1, sway=0.3, lag=lag)
    _, exact = held(1, noisy=False, sway=0.3, lag=lag)
    gains = np.zeros((1, 2, 2))
    gains[0, lag] = STIFFNESS, DAMPING
    mobility = np.full((len(time), 1, 1), 1.0 / INERTIA)
    q, v = fed_back_motion(time, gains, (noisy["e_q"][:, None], noisy["e_v"][:, None]), mobility)
    np.testing.assert_allclose(q[:, 0], noisy["q"] - exact["q"], atol=1e-9)
    np.testing.assert_allclose(v[:, 0], noisy["v"] - exact["v"], atol=1e-9)


def test_a_controller_is_known_by_its_efforts_and_the_noise(tmp_path: Path) -> None:
    problem = cast(WeakProblem, problem_of(tmp_path, sway=0.002)[0])
    run = problem.runs[0]
    assert run.measured is not None and run.weak.samples.estimated is not None
    read, known = run.measured.samples, run.weak.samples.estimated
    gains = feedback_gains(read.u, read.q, read.v)
    mobility = np.full((len(read.time), 1, 1), 1.0 / INERTIA)
    _, expected = fed_back_motion(read.time, gains, (read.q - known.q, read.v - known.v), mobility)
    assert np.std(expected) > 1e-5
    found = fed_back(run, problem.scene.physics)
    np.testing.assert_allclose(found["v.pivot"], expected[:, 0], rtol=1e-6, atol=1e-12)


def test_of_velocities_that_were_not_recorded_no_response_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = cast(WeakProblem, problem_of(tmp_path, "qu", sway=0.002)[0])
    still = np.zeros((3000, 1))
    monkeypatch.setattr(sensor_columns, "feedback_gains", lambda *of: np.ones((1, 2, 2)))
    monkeypatch.setattr(sensor_columns, "fed_back_motion", lambda *of: (still, still))
    assert not fed_back(problem.runs[0], problem.scene.physics)


@pytest.mark.parametrize(("part", "known"), [(0.5, True), (0.95, False)])
def test_where_hardly_anything_but_noise_moves_nothing_is_known(tmp_path: Path, part: float, known: bool) -> None:
    samples = cast(WeakProblem, problem_of(tmp_path, sway=0.3)[0]).runs[0].weak.samples
    delay, columns = effect_named("sensor_delay")("v.pivot"), ("v.pivot",)
    fed = part * samples.recording["v.pivot"][:, None]
    whole, rest = (SensorSlopes(samples).of(delay, columns, False, own) for own in (None, fed))
    np.testing.assert_allclose(rest, (1.0 - part) * whole if known else 0.0 * whole, atol=1e-9 * np.max(np.abs(whole)))


@pytest.mark.parametrize("size", [1e3, np.inf])
def test_a_response_that_cannot_be_simulated_is_none(
    tmp_path: Path, size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = cast(WeakProblem, problem_of(tmp_path, sway=0.002)[0])
    run = problem.runs[0]
    far = np.linspace(-size, size, 3000)[:, None] if np.isfinite(size) else np.full((3000, 1), size)
    assert fed_back(run, problem.scene.physics)
    monkeypatch.setattr(sensor_columns, "fed_back_motion", lambda *of: (far, far))
    assert not fed_back(run, problem.scene.physics)


@pytest.mark.parametrize("sway", [0.0, 0.002, 0.01])
def test_a_joint_that_is_held_by_its_noisy_velocity_tells_of_no_delay(tmp_path: Path, sway: float) -> None:
    """It had lowered χ² by hundreds: the joint moves as its noise did."""
    assert late_gain(tmp_path, sway=sway) < 12.0


@pytest.mark.parametrize("noisy", [True, False])
def test_a_delay_that_is_there_is_seen_all_the_same(tmp_path: Path, noisy: bool) -> None:
    assert late_gain(tmp_path, noisy=noisy, sway=0.3, delay=4) > 200.0
