"""Unknown initial states of lags, delays and rotors: their part in the covariance of weak-form rows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import fit, unbiased_fit
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.initial_uncertainty import StartMarginal, gap_start_rows, start_rows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorLag, Effort
from drake_cafim.effects.coupling import JointBacklash, RotorDrive
from drake_cafim.effects.timing import POINTS, SensorLag
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

LATER = 500
"""Samples."""


def _begun_later(rig: str, folder: Path) -> tuple[Scene, Recording, WeakForm]:
    """A scene, a recording, and the weak form of what is left of it after `LATER` samples."""
    simulate("null", rig, 3).write(folder)
    scene = Scene.load(folder / "scenario.yaml")
    whole = recordings.read(folder / "train_1.parquet")
    late = replace(whole, time=whole.time[LATER:], columns={k: values[LATER:] for k, values in whole.columns.items()})
    prepared = prepare(scene, [late])
    assert isinstance(prepared, Prepared)
    return scene, whole, prepared.problem().runs[0].weak


def _assert_in_proportion(rows: Array, missed: Array, expected: float) -> None:
    """Rows of a doubt's standard deviation are those of what was missed, by its size in such deviations."""
    size = float(rows @ missed / (rows @ rows))
    assert float(np.linalg.norm(size * rows - missed)) < 0.02 * float(np.linalg.norm(missed))
    assert abs(size) == pytest.approx(abs(expected), rel=0.02)


@pytest.mark.long
def test_an_effort_was_behind(tmp_path: Path) -> None:
    scene, whole, weak = _begun_later("arm2", tmp_path)
    name = scene.tree.joint_names[0]
    lag = ActuatorLag(name, {"time_constant": 0.08})
    time, u = weak.samples.time, weak.samples.u[:, 0]
    acting = lag.drive(Effort(whole.time, whole[f"u.{name}"])).means(whole.time)[LATER:]
    settled = lag.drive(Effort(time, u)).means(time)
    rows = start_rows(weak, scene.physics.with_effects([lag]))[:, weak.dynamic.start, 0]
    missed = -(weak.samples.windows.value @ (acting - settled))
    _assert_in_proportion(rows, missed, (acting - settled)[0] / float(np.std(u - settled)))


@pytest.mark.long
def test_what_a_wrench_sensor_writes_was_behind(tmp_path: Path) -> None:
    scene, whole, weak = _begun_later("press", tmp_path)
    sensor = f"wrench.{weak.sensors[0].name}"
    lag = SensorLag(sensor, {"time_constant": 0.08})
    felt = np.stack([whole[f"{sensor}.{axis}"] for axis in WRENCH_COMPONENTS], axis=1)
    written, settled = lag.measured(whole.time, felt)[LATER:], lag.measured(weak.samples.time, felt[LATER:])
    rows = start_rows(weak, scene.physics.with_effects([lag]))
    assert rows.shape[2] == len(WRENCH_COMPONENTS)
    usual = np.std(felt[LATER:] - settled, axis=0)
    # samples at a recording's very beginning have other neighbours than in the middle of one
    time, past = weak.samples.time, POINTS
    behind = (written - settled)[past] * np.exp((time[past] - time[0]) / lag.values["time_constant"])
    for k in range(len(WRENCH_COMPONENTS)):
        missed = weak.samples.windows.value @ (written - settled)[:, k]
        _assert_in_proportion(rows[:, weak.dynamic.stop + k, k], missed, behind[k] / usual[k])
        others = np.delete(rows[:, :, k], weak.dynamic.stop + k, axis=1)
        assert not np.any(others)


@pytest.mark.long
def test_a_rotor_began_anywhere_in_its_gap(tmp_path: Path) -> None:
    """In the middle of a motion; a start at rest on a flank leaves 47 standard deviations in the first windows."""
    case = simulate("single:joint_backlash", "arm2", 0x20CEF9A0633F4354B6CB501EAFBBD008)
    scene, read = written(case, tmp_path)
    problem = prepare(scene, read).problem()
    [effect] = case.truth["effects"]
    values = {name: value for name, (value, _) in effect["parameters"].items()}
    found = fit(problem, problem.nominal().with_effects([JointBacklash(effect["at"], values)]))
    own = problem.rewhitened(found.model)
    found = unbiased_fit(own, found.model)
    assert leaves_noise(own, found, 0.01)
    for name in values:
        assert found.model.effects[0].values[name] == pytest.approx(values[name], rel=0.01)


def test_a_start_in_a_gap_is_forgotten(tmp_path: Path) -> None:
    """Doubts are of the first windows alone, as far as starts at either flank and between them differ."""
    _, _, weak = _begun_later("arm2", tmp_path)
    time = weak.samples.time
    push = 40.0 * np.sin(2.0 * np.pi * 1.5 * time)
    gap = JointBacklash("elbow", {"gap": 0.01, "stiffness": 1000.0, "damping": 10.0})
    drive = RotorDrive(time, push, np.full(len(time), 10.0), 0.2)
    windows = weak.samples.windows
    doubts = gap_start_rows(gap, drive, windows)
    shown = np.flatnonzero(np.any(doubts != 0.0, axis=1))
    assert len(shown) and np.array_equal(shown, np.arange(len(shown))) and len(shown) < 12
    change = np.abs(windows.rate @ (gap.twist_rates_from(drive) - gap.twist_rate(drive)[:, None]))
    assert np.max(change[len(shown) : 12]) <= 0.01 * np.max(change)


def _told(rows: Array, U: Array) -> float:
    begun = StartMarginal.of(rows, U)
    return float(begun.rows @ begun.rows) + begun.paid


@pytest.mark.parametrize("off", [0.5, 3.5, 12.0])
def test_a_start_is_paid_for_as_far_as_it_is_off(off: float) -> None:
    """Of a doubt that could move the rows by 400 standard deviations; it used to be paid for as if it did."""
    doubt = np.zeros((50, 1))
    doubt[:4, 0] = 200.0
    rows = np.random.default_rng(0).normal(size=50)
    rows += doubt[:, 0] / 400.0 * (off - float(rows @ doubt[:, 0]) / 400.0)
    wanted = off**2 if off < 1.0 else 1.0 + np.log(off**2)
    assert _told(rows, doubt) == pytest.approx(float(rows @ rows) - off**2 + wanted, abs=1e-6)
    if off > 1.0:
        assert float(StartMarginal.of(rows, doubt).start @ doubt[0]) == pytest.approx(
            -(off - 1.0 / off) / 2.0, rel=1e-3
        )


def test_doubts_that_look_alike_are_as_wide_as_is_likeliest() -> None:
    rng = np.random.default_rng(1)
    doubts = rng.normal(size=(60, 3)) @ np.array([[30.0, 20.0, 0.0], [0.0, 20.0, 0.3], [0.0, 0.0, 0.1]])
    for size in (0.0, 0.1, 2.0):
        rows = rng.normal(size=60) + doubts @ rng.normal(size=3) * size
        covariances = (np.eye(60) + (doubts * widths**2) @ doubts.T for widths in rng.uniform(size=(400, 3)) ** 3)
        tried = [rows @ np.linalg.solve(C, rows) + np.linalg.slogdet(C)[1] for C in covariances]
        assert _told(rows, doubts) <= min(*tried, float(rows @ rows)) + 1e-6
        begun = StartMarginal.of(rows, doubts)
        own = np.eye(60) + (doubts * begun.widths**2) @ doubts.T if begun.paid > 0.0 else np.eye(60)
        assert _told(rows, doubts) == pytest.approx(rows @ np.linalg.solve(own, rows) + np.linalg.slogdet(own)[1])
