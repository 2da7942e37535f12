"""The noise of each column: as the scenario states it, or estimated where it does not."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.slow_channels import without_empty_rows
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

_DIFFERENCES = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


def noise_of(scene: Scene, recordings: Sequence[Recording]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Standard deviation of one sample by column, SI, and a note for each that was estimated.

    Raises `InputError` where a needed column is missing, or where an estimate is zero (the column does not change).
    """
    names = scene.tree.joint_names
    for recording in recordings:
        recording.matrix("u", names)  # a column that is not there is told of before one that holds nothing
    columns = [f"{kind}.{name}" for kind in ("q", "u") for name in names]
    columns += [f"v.{name}" for name in names if all(f"v.{name}" in r.columns for r in recordings)]
    columns += [f"wrench.{sensor.name}.{axis}" for sensor in scene.wrench_sensors for axis in WRENCH_COMPONENTS]
    std: dict[str, float] = {}
    notes = []
    for column in columns:
        stated = scene.std(column)
        if stated is None:
            # an effort that nothing is said of is the command itself
            stated = 0.0 if column.startswith("u.") else _estimated([r.measured(column) for r in recordings])
            notes.append(
                f"channels: no std for {column}, {stated:.3g} was "
                + ("taken" if column.startswith("u.") else "estimated from fourth differences")
            )
        if stated == 0.0 and not column.startswith("u."):
            raise InputError(f"{scene.name}: the noise of {column} is 0, expected a positive std under channels")
        std[column] = stated
    return std, tuple(notes)


def _estimated(samples: Sequence[Array]) -> float:
    """From differences of order four, which a smooth motion hardly enters; robust (median absolute deviation)."""
    written = [without_empty_rows(values) for values in samples]
    differences = np.concatenate([np.convolve(values, _DIFFERENCES, mode="valid") for values in written])
    spread = float(np.nanmedian(np.abs(differences))) * 1.4826
    return spread / float(np.linalg.norm(_DIFFERENCES))
