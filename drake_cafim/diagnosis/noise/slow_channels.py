"""Interpolation of channels that are sampled more slowly than the other channels of their recording."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.thresholds import SLOW_CHANNEL_EMPTY_SHARE, SLOW_CHANNEL_LONGEST_INTERVAL
from drake_cafim.effects.timing import interpolation
from drake_cafim.recordings.recording import Recording, is_signal

Bridges = Mapping[str, sp.csr_matrix]


def bridge_slow_channels(recording: Recording) -> tuple[Recording, Bridges]:
    """The recording with its slow channels interpolated to every row, and each one's interpolation matrix (N, N).

    Matrix columns that belong to empty rows are zero, so that noise enters through the written samples alone. Efforts
    are held between samples by definition and stay as they are; so do channels with long gaps, in which data are
    missing rather than sampled slowly.
    """
    bridges: dict[str, sp.csr_matrix] = {}
    columns = dict(recording.columns)
    for name, values in recording.columns.items():
        if not is_signal(name) or name.startswith(("u.", "cmd.")):
            continue
        written = np.isfinite(values)
        if not written.any() or written.mean() > 1.0 - SLOW_CHANNEL_EMPTY_SHARE:
            continue
        instants = recording.time[written]
        ends = max(instants[0] - recording.time[0], recording.time[-1] - instants[-1])
        if len(instants) < 3 or max(float(np.diff(instants).max()), ends) > SLOW_CHANNEL_LONGEST_INTERVAL:
            continue
        between = sp.coo_matrix(interpolation(instants, recording.time))
        at = np.flatnonzero(written)[between.col]
        shape = (len(values), len(values))
        bridges[name] = sp.csr_matrix((between.data, (between.row, at)), shape=shape)
        columns[name] = bridges[name] @ np.where(written, values, 0.0)
    if not bridges:
        return recording, {}
    note = f"{', '.join(bridges)}: fewer samples than the recording has rows; the other rows were interpolated"
    return replace(recording, columns=columns, notes=(*recording.notes, note)), bridges
