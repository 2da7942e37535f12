"""The noise of each column: as the scenario states it, or estimated where it does not."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.even_clock import evened
from drake_cafim.diagnosis.quantisation import quantum
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

DIFFERENCES = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
GAP = 1.2
"""Of the usual time that five samples take, beyond which one is missing."""


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
            stated = 0.0 if column.startswith("u.") else _estimated(recordings, column)
            notes.append(
                f"channels: no std for {column}, {stated:.3g} was "
                + ("taken" if column.startswith("u.") else "estimated from fourth differences")
            )
        if stated == 0.0 and not column.startswith("u."):
            raise InputError(f"{scene.name}: the noise of {column} is 0, expected a positive std under channels")
        std[column] = stated
    return std, tuple(notes)


def _estimated(recordings: Sequence[Recording], column: str) -> float:
    """From differences of order four, which a smooth motion hardly enters; robust (median absolute deviation).

    Values on a lattice have few differences, whose median says little, and the error of rounding a slow motion hardly
    enters them: their mean square is taken, and at least a rounding error's.
    """
    samples = [recording.measured(column) for recording in recordings]
    differences = np.concatenate([_differences(r.time, values) for r, values in zip(recordings, samples, strict=True)])
    step = max((quantum(values) or 0.0 for values in samples), default=0.0)
    if step > 0.0:
        return max(float(np.sqrt(np.mean(differences**2))), step / float(np.sqrt(12.0)))
    return 1.4826 * float(np.median(np.abs(differences)))


def _differences(time: Array, values: Array) -> Array:
    """Of order four and of the noise's own size, over neighbours without a gap."""
    there = np.isfinite(values)
    time, values = time[there], evened(time[there], values[there])
    span = time[4:] - time[:-4]
    found = np.convolve(values, DIFFERENCES, mode="valid") / float(np.linalg.norm(DIFFERENCES))
    return np.asarray(found[span < GAP * np.median(span)])
