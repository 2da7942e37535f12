"""What makes a recording of no use to any fit: too few samples, a clock that jumps, numbers that no robot has."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording

FEWEST = 8
"""Samples, below which not even noise can be told from motion."""
LONGEST_GAP = 600.0
"""s: whatever stands after a longer pause is another recording."""
LARGEST = 1e9
"""In SI units: no joint, effort, force or place of a robot is as large, and the square of it still is a number."""


def check_usable(recording: Recording, columns: Sequence[str]) -> None:
    """Raises `InputError` for fewer than `FEWEST` samples, a longer gap than `LONGEST_GAP` s, or a value of one of
    `columns` (those that are there) beyond `LARGEST`."""
    count = len(recording)
    if count < FEWEST:
        raise InputError(f"{recording.name}: only {count} sample{'s' * (count != 1)}, expected at least {FEWEST}")
    steps = np.diff(recording.time)
    worst = int(np.argmax(steps))
    if steps[worst] > LONGEST_GAP:
        raise InputError(
            f"{recording.name}: column time jumps by {steps[worst]:.6g} s at sample {worst + 2} of {count}, expected "
            f"gaps of at most {LONGEST_GAP:g} s; cut the recording in two there"
        )
    for column in columns:
        values = np.abs(recording.columns.get(column, np.zeros(1)))
        if np.all(np.isnan(values)) or not np.nanmax(values) > LARGEST:
            continue
        at = int(np.nanargmax(values))
        raise InputError(
            f"{recording.name}: column {column} holds {recording.columns[column][at]:.6g} at "
            f"{recording.time[at]:.6g} s, expected SI units and at most {LARGEST:g}"
        )
