"""Channels that were filtered after they were measured: velocities that do not serve, and filters nobody states.

Whatever a sensor measures, noise and quantisation reach up to the Nyquist frequency. A channel whose upper half of the
spectrum is empty was low-passed after it was measured.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import welch

from drake_cafim.diagnosis.thresholds import EMPTY_SPECTRUM_SHARE
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

SEGMENT = 1024
"""Most samples of one periodogram."""
FEWEST = 128
"""Fewest samples of a channel whose spectrum is looked at."""
PASSED = 1e-6
"""Share of a channel's power beyond the frequency that is told as the end of what is left."""


def without_filtered_velocities(
    scene: Scene, recordings: Sequence[Recording]
) -> tuple[list[Recording], tuple[str, ...]]:
    """The recordings without velocities where the scenario states that some were filtered, and a note on that.

    A filtered velocity is none of the joint's, and the positions tell it: as where no velocity was recorded, they are
    differentiated against the test functions.
    """
    columns = [f"v.{name}" for name in scene.tree.joint_names]
    channels = [scene.channel(column) for column in columns]
    filtered = [c for c, channel in zip(columns, channels, strict=True) if channel is not None and channel.lowpass]
    if not filtered:
        return list(recordings), ()
    kept = [
        replace(item, columns={name: values for name, values in item.columns.items() if name not in columns})
        for item in recordings
    ]
    note = f"{', '.join(filtered)}: filtered after they were measured; the positions tell the velocities instead"
    return kept, (note,)


def notes_on_filters(scene: Scene, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """A sentence on the measured velocities and efforts that are filtered, and of which no `lowpass` is stated."""
    seen: dict[str, float] = {}
    for recording in recordings:
        for name in scene.tree.joint_names:
            for column in (f"v.{name}", f"u.{name}"):
                channel = scene.channel(column)
                if (channel is not None and channel.lowpass is not None) or scene.std(column) == 0.0:
                    continue
                end = end_of_spectrum(recording, column)
                if end is not None:
                    seen[column] = max(end, seen.get(column, 0.0))
    if not seen:
        return ()
    worst = max(seen.values())
    return (
        f"{', '.join(seen)}: nothing is left above about {worst:.2g} Hz, as of a channel that was low-passed after it "
        "was measured; where the scenario does not state the filter (`channels: u: {lowpass: ...}`), what it took away "
        "counts as physics",
    )


def end_of_spectrum(recording: Recording, column: str) -> float | None:
    """The frequency, Hz, above which nothing is left in the column; None where its spectrum is not empty there."""
    values = recording.columns.get(column)
    if values is None or np.count_nonzero(np.isfinite(values)) < FEWEST:
        return None
    rate = 1.0 / float(np.median(np.diff(recording.time)))
    frequency, power = _spectrum(values[np.isfinite(values)], rate)
    whole, upper = np.sum(power), np.sum(power[frequency > 0.5 * frequency[-1]])
    if not whole > 0.0 or upper >= EMPTY_SPECTRUM_SHARE**2 * whole:
        return None
    beyond = np.cumsum(power[::-1])[::-1]
    return float(frequency[np.flatnonzero(beyond >= PASSED * whole)[-1]])


def _spectrum(values: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies and power densities of Welch's method, less a trend, which has a spectrum of its own."""
    frequency, power = welch(values, rate, nperseg=min(SEGMENT, len(values) // 2), detrend="linear")
    return np.asarray(frequency[1:], dtype=float), np.asarray(power[1:], dtype=float)
