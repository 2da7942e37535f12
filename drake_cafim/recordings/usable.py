"""Checks that a recording can be fitted at all: enough samples, no jump of the clock, values of plausible size."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording

FEWEST = 8
"""Smallest number of samples; with fewer, noise cannot be separated from motion."""
LONGEST_STEP = 0.5
"""s, smallest median step of time that is refused: slower than robots are sampled, and what 2 kHz are in ms."""
LONGEST_GAP = 600.0
"""s, longest step of time; samples after a longer pause belong to another recording."""
LARGEST = 1e9
"""Largest absolute value in SI units: above any position, effort or force of a robot; its square does not overflow."""


def check_usable(recording: Recording, columns: Sequence[str]) -> None:
    """Raises `InputError` for too few samples, a clock that is not in seconds, a long gap, or a value above `LARGEST`.

    The fewest are `FEWEST` samples, the longest gap is `LONGEST_GAP`. Only the `columns` that the recording has are
    checked.
    """
    count = len(recording)
    if count < FEWEST:
        left_out = next((f" ({note})" for note in recording.notes if note.startswith("time: ")), "")
        raise InputError(
            f"{recording.name}: only {count} sample{'s' * (count != 1)}, expected at least {FEWEST}{left_out}"
        )
    steps = np.diff(recording.time)
    usual = float(np.median(steps))
    if usual >= LONGEST_STEP:
        raise InputError(
            f"{recording.name}: column time has steps of {usual:.6g} s, as milliseconds or nanoseconds would; expected "
            f"seconds, and more than {1.0 / LONGEST_STEP:g} samples in each"
        )
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
