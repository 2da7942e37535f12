"""A joint that rests is moved by the noise that its controller feeds back: what it then does tells of no delay."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.joints.linearised_effects import looks
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.noise.coloured import Memory
from drake_cafim.diagnosis.search.search import search
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.actuator import ActuatorBias, ActuatorDelay, ActuatorLag
from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.typing import Array
from tests.turntable import problem_of, write_turntable

INERTIA, ROTOR, STEP = 0.2, 0.05, 0.002
Q_STD, V_STD, MEMORY = 1e-4, 2e-3, 0.01


def _held(seed: int, amplitude: float) -> pd.DataFrame:
    """Samples of a joint that is held by feedback of its noisy samples, beside an effort that swings it."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(2500)
    swing = amplitude * np.sin(2.0 * np.pi * 0.7 * time)
    noise_q, noise_v = Q_STD * rng.normal(size=len(time)), V_STD * Memory(MEMORY).drawn(rng, time)
    q, v, rows = 0.0, 0.0, []
    for k in range(len(time)):
        read = (q + noise_q[k], v + noise_v[k])
        effort = swing[k] - INERTIA * (36.0 * read[0] + 10.0 * read[1])
        rows.append((*read, effort))
        q, v = q + STEP * v + 0.5 * STEP**2 * effort / INERTIA, v + STEP * effort / INERTIA
    table: Array = np.array(rows)
    return pd.DataFrame({"time": time, "q.axis": table[:, 0], "v.axis": table[:, 1], "u.axis": table[:, 2]})


def _problem(folder: Path, seed: int, amplitude: float) -> WeakProblem:
    write_turntable(folder, _held(seed, amplitude), (Q_STD, V_STD), INERTIA - ROTOR, rotor=ROTOR)
    return problem_of(folder)


@pytest.mark.parametrize("seed", [1, 3])
def test_it_raises_no_alarm(tmp_path: Path, seed: int) -> None:
    """A late sensor, or a soft gear, had p-values of 6e-4 and 2e-4 here."""
    found = search(_problem(tmp_path, seed, 0.0), Settings(most_effects=0))
    assert found.detection_p_value > Settings().false_alarm_rate


@pytest.mark.parametrize(("amplitude", "asked"), [(0.0, False), (1.0, True)])
def test_only_a_joint_that_moves_is_asked_for_delays(tmp_path: Path, amplitude: float, asked: bool) -> None:
    problem = _problem(tmp_path, 1, amplitude)
    at = fit(problem, problem.nominal())
    wanted = SensorDelay("v.axis"), ActuatorDelay("axis"), ActuatorLag("axis"), JointElasticity("axis")
    assert [any(True for _ in looks(problem, at, effect).found) for effect in wanted] == 4 * [asked]
    assert any(True for _ in looks(problem, at, ActuatorBias("axis")).found)
