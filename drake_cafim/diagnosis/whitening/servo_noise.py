"""How the rows change through the efforts that position servos make of what their encoders read."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.whitening.noise_jacobian import place
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def read_by_servos(run: Run, physics: Physics, columns: Sequence[str], change: Array) -> Array:
    """Whitened change (R, k) of the rows by the servos' efforts when `columns` of positions change by `change`.

    `change` is (N, c, k). A bias of an encoder moves the joint, since its servo sees the same bias: in the rows the
    recorded position then stands for another one of the joint, and the servo's effort stays as it is.
    """
    weak = run.weak
    windows = weak.samples.windows
    rows = np.zeros((run.rows, change.shape[2]))
    for j, drive in weak.terms(physics).servos.items():
        column = f"q.{physics.tree.joints[j].name}"
        if column in columns:
            moved = drive.mean.d_q[:, None] * change[:, list(columns).index(column)]
            acts = place(weak, -windows.value, weak.kinematic_rows + j)
            rows += np.asarray(acts @ moved) / physics.effort_gains[j]
    return run.whiten(rows)
