"""What a lag that was behind at the first sample does to rows, against recordings that began earlier."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from concealed.make import simulate

from drake_cafim import recordings
from drake_cafim.diagnosis.beginning import start_rows
from drake_cafim.diagnosis.diagnose import Prepared, prepare
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorLag, Effort
from drake_cafim.effects.timing import POINTS, SensorLag
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

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
