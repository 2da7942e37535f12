"""The standard deviation of each column's noise: as the scenario states it, otherwise estimated."""

from collections.abc import Sequence

from drake_cafim.diagnosis.noise.differences import noise_std
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scene.driving import idle_joints, with_idle_efforts
from drake_cafim.scene.scene import Scene

LEAST_STD = 1e-100
"""Smallest std that counts as positive, SI units: the square of a smaller one underflows."""


def noise_of(scene: Scene, recordings: Sequence[Recording]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Standard deviation of one sample by column, SI units, and a note for each one that was estimated.

    An effort whose std the scenario does not state gets 0 here; it is estimated later, from the equations' likelihood.
    A velocity that not every recording has gets none.

    Raises `InputError` where a needed column is missing, or where a std other than an effort's is stated or estimated
    as zero (a column that does not change).
    """
    names = scene.tree.joint_names
    idle = {f"u.{name}" for recording in recordings for name in idle_joints(scene, recording)}
    for recording in recordings:
        # a missing column is reported before a constant one
        with_idle_efforts(scene, recording).matrix("u", names)
    unmeasured = {f"v.{name}" for name in names if not all(f"v.{name}" in r.columns for r in recordings)}
    columns = [column for column in needed_columns(scene) if column not in unmeasured]
    std: dict[str, float] = {}
    notes = []
    if unmeasured and any(f"v.{name}" in r.columns for r in recordings for name in names):
        column, lacking = next((c, r.name) for c in sorted(unmeasured) for r in recordings if c not in r.columns)
        notes.append(f"no velocity is read, since {column} is not in {lacking}: the positions tell the velocities")
    for column in columns:
        stated = scene.std(column)
        if column in idle or (stated is None and column.startswith("u.")):
            # its differences would contain the sensors' noise that the controller feeds back
            stated = 0.0
        elif stated is None:
            stated = noise_std([(r.time, r.measured(column)) for r in recordings])
            notes.append(f"channels: no std for {column}; {stated:.3g} was estimated from its fourth differences")
        if stated < LEAST_STD and not column.startswith("u."):
            raise InputError(
                f"{scene.name}: the std of {column} is 0 (stated, or estimated from a column that does not change), "
                "expected a positive std under channels"
            )
        std[column] = stated
    return std, tuple(notes)


def needed_columns(scene: Scene) -> list[str]:
    """The columns that a diagnosis of joints reads from a recording; those of v may be missing in it."""
    columns = [f"{kind}.{name}" for kind in ("q", "u", "v") for name in scene.tree.joint_names]
    columns += [f"wrench.{sensor.name}.{axis}" for sensor in scene.wrench_sensors for axis in WRENCH_COMPONENTS]
    return columns
