"""Notes on recordings before their diagnosis: mistakes of the data, ignored columns, repairs while reading."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from drake_cafim.diagnosis.noise.slow_channels import bridge_slow_channels
from drake_cafim.diagnosis.notes.data_mistakes import data_mistakes
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.units import unit_mistakes
from drake_cafim.scene.driving import undriven
from drake_cafim.scene.scene import Scene

JOINT_KINDS = ("q", "v", "u", "cmd")
BEYOND = 5.0
"""Distance of a position from a limit, in standard deviations of its noise, from which on it is beyond the limit."""


def mistakes_of(scene: Scene, recordings: Sequence[Recording], std: dict[str, float]) -> tuple[str, ...]:
    """A sentence for each mistake: of units where limits show it, otherwise by the equations of motion."""
    limits = {
        j.name: j.position_limits for j in scene.tree.joints if not j.prismatic and np.isfinite(j.position_limits[0])
    }
    units = [unit_mistakes(recording, limits) for recording in recordings]
    others = [
        bridge_slow_channels(recording)[0] for recording, found in zip(recordings, units, strict=True) if not found
    ]
    return (
        *(sentence for found in units for sentence in found),
        *(data_mistakes(scene, others, std) if others else ()),
    )


def notes_on_limits(scene: Scene, recordings: Sequence[Recording], std: Mapping[str, float]) -> list[str]:
    """A note for each joint that goes beyond the limits that the model states: the stop's forces are not modelled."""
    notes = []
    for joint in scene.tree.joints:
        column, unit = f"q.{joint.name}", "m" if joint.prismatic else "rad"
        q = np.concatenate([recording[column][np.isfinite(recording[column])] for recording in recordings])
        lower, upper = joint.position_limits
        for limit, past in ((lower, lower - q), (upper, q - upper)):
            share = np.mean(past > BEYOND * std.get(column, 0.0)) if len(q) else 0.0
            if share > 0.0:
                notes.append(
                    f"{joint.name} goes {np.max(past):.2g} {unit} beyond the limit {limit:g} {unit} that the model "
                    f"states, {100.0 * share:.3g} % of the time; if a stop is there, its forces are not in the model"
                )
    return notes


def notes_on_unknown_joints(scene: Scene, recordings: Sequence[Recording]) -> list[str]:
    """A note for each recording with columns of joints that the model does not have."""
    known = {f"{kind}.{joint}" for kind in JOINT_KINDS for joint in scene.joint_names}
    notes = []
    for recording in recordings:
        columns = [name for name in recording.columns if name.split(".")[0] in JOINT_KINDS and name not in known]
        if columns:
            notes.append(f"{recording.name}: ignored, since the model has no such joint: {', '.join(columns)}")
    return notes


def notes_on_undriven_joints(scene: Scene, recordings: Sequence[Recording]) -> list[str]:
    """A note on joints without a column of efforts that nothing drives by the model: their effort is taken to be 0."""
    found = sorted({name for recording in recordings for name in undriven(scene, recording)})
    columns = ", ".join(f"u.{name}" for name in found)
    return [f"no column {columns}: by the model nothing drives {', '.join(found)}, whose effort is 0"] if found else []


def notes_of(recordings: Sequence[Recording], read: Collection[str] = ()) -> tuple[str, ...]:
    """Notes on each recording from reading its file, and on ignored columns; `read` are other columns that are used."""
    notes: list[str] = []
    for recording in recordings:
        notes.extend(f"{recording.name}: {note}" for note in recording.notes)
        ignored = [column for column in recording.other_columns if column not in read]
        if ignored:
            notes.append(f"{recording.name}: ignored columns: {', '.join(ignored)}")
    return tuple(notes)
