"""Efforts interpolated linearly between samples (`hold: first_order`) in rows, forecasts and actuator effects."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.predict.stepper import State, acting_efforts, advance
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.effects.actuator import ActuatorDeadZone, ActuatorDelay, ActuatorLag, ActuatorSaturation, Effort
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests import two_links


def _prepared(folder: Path, hold: str, ramped: bool) -> Prepared:
    folder.mkdir()
    scene = two_links.scene(folder, two_links.CHANNELS.replace("0.0}", f"0.0, hold: {hold}}}"))
    prepared = prepare(scene, [two_links.recording("run", 1, ramped=ramped)])
    assert isinstance(prepared, Prepared)
    return prepared


def _chi_square(prepared: Prepared) -> float:
    problem = prepared.problem()
    rows = problem.rows_of(problem.under)
    return float(rows @ rows) / len(rows)


def _error(scene: Scene, run: Recording, ramped: bool) -> float:
    """How far a simulation from the recording's first sample is off after 0.4 s, rad."""
    time = run.time[:101]
    knots, efforts = acting_efforts(scene.physics, time, run.matrix("u", two_links.JOINTS)[:101], (ramped, ramped))
    state = State(*(run.matrix(kind, two_links.JOINTS)[:1] for kind in "qv"))
    for effort, duration in zip(efforts, np.diff(knots), strict=False):
        state = advance(scene.physics, state, effort[None], np.array([duration]))
    return float(np.max(np.abs(state.q - run.matrix("q", two_links.JOINTS)[100])))


def test_rows_follow_the_effort_as_it_was(tmp_path: Path) -> None:
    found = {
        (hold, ramped): _prepared(tmp_path / f"{hold}_{ramped}", hold, ramped)
        for hold in ("zero_order", "first_order")
        for ramped in (False, True)
    }
    right = [_chi_square(found["zero_order", False]), _chi_square(found["first_order", True])]
    wrong = [_chi_square(found["first_order", False]), _chi_square(found["zero_order", True])]
    assert right == pytest.approx([1.0, 1.0], abs=0.15)
    assert min(wrong) > 1.5


@pytest.mark.parametrize("ramped", [False, True])
def test_a_simulation_follows_the_effort_as_it_was(ramped: bool, tmp_path: Path) -> None:
    run = two_links.recording("run", 1, duration=0.5, noise=(0.0, 0.0, 0.0), ramped=ramped)
    scene = two_links.scene(tmp_path)
    assert _error(scene, run, ramped) < 0.1 * _error(scene, run, not ramped)


TIMES = 0.01 * np.arange(60)
VALUES = np.sin(40.0 * TIMES) + 0.3 * np.random.default_rng(0).normal(size=60)
FINE = np.linspace(0.1, 0.5, 40001)


def _asked(at: Array) -> Array:
    return np.asarray(np.interp(at, TIMES, VALUES))


def _lagging(tau: float) -> Array:
    fine = np.arange(0.0, 0.5, 1e-5)
    y, kept = np.empty(len(fine)), np.exp(-1e-5 / tau)
    y[0] = VALUES[0]
    for k, u in enumerate(_asked(fine[:-1] + 5e-6)):
        y[k + 1] = u + (y[k] - u) * kept
    return np.asarray(np.interp(FINE, fine, y))


@pytest.mark.parametrize(
    ("effect", "acting"),
    [
        (ActuatorDelay("a", {"delay": 0.013}), _asked(FINE - 0.013)),
        (ActuatorSaturation("a", {"limit": 0.4}), np.clip(_asked(FINE), -0.4, 0.4)),
        (ActuatorDeadZone("a", {"width": 0.3}), _asked(FINE) - np.clip(_asked(FINE), -0.3, 0.3)),
        (ActuatorLag("a", {"time_constant": 0.02}), _lagging(0.02)),
    ],
)
def test_effects_drive_a_ramp_as_their_closed_form(effect: ActuatorLag, acting: Array) -> None:
    edges = np.linspace(0.1, 0.5, 41)
    found = effect.drive(Effort(TIMES, VALUES, ramped=True)).means(edges)[:-1]
    exact = acting[:-1].reshape(40, -1).mean(axis=1)
    np.testing.assert_allclose(found, exact, atol=2e-3)
