"""Channels that are written less often than others of their recording: between their samples a polynomial stands."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from drake_cafim.effects.timing import interpolation
from drake_cafim.recordings.recording import Recording, is_signal

FEWEST, LONGEST = 0.2, 0.012
"""The share of its rows that a slow channel leaves empty at least, and the time between its samples at most, s."""

Bridges = Mapping[str, sp.csr_matrix]


def bridged(recording: Recording) -> tuple[Recording, Bridges]:
    """The recording with its slow measured channels on the common clock, and the (N, N) matrix that each was laid by.

    The columns of a matrix that belong to empty rows are zero, so noise comes from the samples that there are. Efforts
    are held by definition and stay as they are; so do channels with gaps, which are missing and not slow.
    """
    bridges: dict[str, sp.csr_matrix] = {}
    columns = dict(recording.columns)
    for name, values in recording.columns.items():
        if not is_signal(name) or name.startswith(("u.", "cmd.")):
            continue
        there = np.isfinite(values)
        if not there.any() or there.mean() > 1.0 - FEWEST:
            continue
        own = recording.time[there]
        ends = max(own[0] - recording.time[0], recording.time[-1] - own[-1])
        if len(own) < 3 or max(float(np.diff(own).max()), ends) > LONGEST:
            continue
        between = sp.coo_matrix(interpolation(own, recording.time))
        at = np.flatnonzero(there)[between.col]
        shape = (len(values), len(values))
        bridges[name] = sp.csr_matrix((between.data, (between.row, at)), shape=shape)
        columns[name] = bridges[name] @ np.where(there, values, 0.0)
    if not bridges:
        return recording, {}
    told = f"{', '.join(bridges)}: fewer samples than the recording has rows; read between them"
    return replace(recording, columns=columns, notes=(*recording.notes, told)), bridges
