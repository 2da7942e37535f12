"""Rows each over its own standard deviation: what is left at one place is not that of another."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

PUSHED = 1.0
"""N m at the second joint, back and forth, which nobody knows."""


def test_what_is_left_at_a_joint_does_not_spread_to_its_sensors(tmp_path: Path) -> None:
    scene, read = written(simulate("null", "arm2", 12), tmp_path)
    u = f"u.{scene.tree.joint_names[1]}"
    pushed = [
        replace(part, columns={**part.columns, u: part[u] + PUSHED * np.sign(np.sin(40.0 * part.time))})
        for part in read
    ]
    problem = prepare(scene, pushed).problem()
    assert isinstance(problem, WeakProblem)
    own = problem.rewhitened(problem.nominal())
    rows = own.rows_of(problem.nominal())

    def mean_squares(values: Array) -> Array:
        return np.asarray(np.mean(np.concatenate([z for _, z in by_run(own, values)]) ** 2, axis=0))

    whitened, apart = mean_squares(rows), mean_squares(own.apart(rows))
    # nothing is wrong with the sensors, whose rows come first
    sensors = slice(0, own.runs[0].weak.kinematic_rows)
    assert np.all(whitened[sensors] > 100.0)
    assert np.all(apart[sensors] < 1.3)
    assert apart[-1] > 1e4
