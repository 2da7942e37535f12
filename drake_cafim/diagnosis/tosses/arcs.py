"""Recordings of tosses, cut into short arcs, each with a first estimate of its initial state.

After the first impact a whole toss depends so sensitively on its initial state that a fit does not converge; that of a
short arc does (multiple shooting).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.thresholds import (
    ARC_DURATION,
    ARC_END_SHIFT,
    ARC_FEWEST_SAMPLES,
    ARC_LONGEST_PAUSE,
    ARC_START_REACH,
)
from drake_cafim.diagnosis.tosses.poses import PoseNoise, PoseTrack
from drake_cafim.dynamics.free_body_state import State, stack
from drake_cafim.dynamics.rotations import exponential, inverse, logarithm, product
from drake_cafim.typing import Array

Piece = tuple[int, int, int]
"""Index of the track, its first sample, and its last sample + 1."""


@dataclass(frozen=True)
class Arcs:
    """B arcs of up to S samples each.

    `recording` (B,) is the index of the arc's track, `sample` (B, S) are its samples there and `counts` (B,) their
    number; shorter arcs repeat the last one. `times` (B, S) s, `p` (B, S, 3) m and `quaternion` (B, S, 4) are measured,
    `start` (B) is the first estimate of the initial states.
    """

    tracks: tuple[PoseTrack, ...]
    recording: np.ndarray[Any, np.dtype[np.int64]]
    sample: np.ndarray[Any, np.dtype[np.int64]]
    counts: np.ndarray[Any, np.dtype[np.int64]]
    times: Array
    p: Array
    quaternion: Array
    start: State

    @property
    def names(self) -> tuple[str, ...]:
        """The recordings' names, by track."""
        return tuple(track.recording.name for track in self.tracks)

    @property
    def held(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """(B, S) False for the repeated samples that pad shorter arcs."""
        return np.arange(self.times.shape[1]) < self.counts[:, None]

    def __getitem__(self, rows: Any) -> "Arcs":
        """The arcs of these rows."""
        parts = (getattr(self, k)[rows] for k in ("recording", "sample", "counts", "times", "p", "quaternion", "start"))
        return Arcs(self.tracks, *parts)

    @property
    def first_halves(self) -> "Arcs":
        """The first half of each arc's samples, at least `ARC_FEWEST_SAMPLES` where there are as many."""
        counts = np.maximum(self.counts // 2, np.minimum(self.counts, ARC_FEWEST_SAMPLES))
        kept = np.minimum(np.arange(int(counts.max())), counts[:, None] - 1)
        sample, times = np.take_along_axis(self.sample, kept, axis=1), np.take_along_axis(self.times, kept, axis=1)
        p, quaternion = (np.take_along_axis(part, kept[..., None], axis=1) for part in (self.p, self.quaternion))
        return Arcs(self.tracks, self.recording, sample, counts, times, p, quaternion, self.start)


def arcs_of(tracks: Sequence[PoseTrack], noise: PoseNoise, duration: float = ARC_DURATION) -> Arcs:
    """The tracks cut into arcs of about `duration` s, at samples where the motion is smooth."""
    pieces: list[Piece] = []
    for index, track in enumerate(tracks):
        misfit = _local_states(track, noise)[1]
        pieces += [(index, first, stop) for first, stop in _cuts(track.time, misfit, duration)]
    return arcs_of_pieces(tracks, noise, pieces)


def arcs_of_pieces(tracks: Sequence[PoseTrack], noise: PoseNoise, pieces: Sequence[Piece]) -> Arcs:
    """The arcs of given pieces of the tracks."""
    local = [_local_states(track, noise)[0] for track in tracks]
    starts = [local[index][[first]] for index, first, _ in pieces]
    counts = np.array([stop - first for _, first, stop in pieces])
    columns = np.minimum(np.arange(int(counts.max())), counts[:, None] - 1)
    sample = np.array([first for _, first, _ in pieces])[:, None] + columns
    recording = np.array([index for index, _, _ in pieces])
    sources = [(tracks[r], own) for r, own in zip(recording, sample, strict=True)]
    times, p, quaternion = (
        np.stack([getattr(track, name)[own] for track, own in sources]) for name in ("time", "p", "quaternion")
    )
    start = stack(starts)
    return Arcs(tuple(tracks), recording, sample, counts, times, p, quaternion, start)


def _cuts(time: Array, misfit: Array, duration: float) -> list[tuple[int, int]]:
    """First and last + 1 sample of each arc; a stretch without pauses is cut into arcs of about equal duration.

    Each end is moved to the sample with the least `misfit` of the local cubic: an impact there would spoil the first
    estimate of the next arc's state.
    """
    steps = np.diff(time)
    breaks = np.flatnonzero(steps > ARC_LONGEST_PAUSE * np.median(steps))
    found: list[tuple[int, int]] = []
    for begin, end in itertools.pairwise([0, *(breaks + 1).tolist(), len(time)]):
        if end - begin < ARC_FEWEST_SAMPLES:
            continue
        span = time[end - 1] - time[begin]
        count = max(1, min(round(span / duration), (end - begin) // ARC_FEWEST_SAMPLES))
        edges = [begin]
        for k in range(1, count):
            middle = time[begin] + span * k / count
            low, high = np.searchsorted(time, middle + np.array([-ARC_END_SHIFT, ARC_END_SHIFT]) * span / count)
            low = max(int(low), edges[-1] + ARC_FEWEST_SAMPLES // 2)
            high = max(int(high), low + 1)
            edges.append(low + int(np.argmin(misfit[low:high])))
        found += itertools.pairwise([*edges, end])
    return found


def _local_states(track: PoseTrack, noise: PoseNoise) -> tuple[State, Array]:
    """The state at each sample by a cubic fitted to its neighbours, and the χ² of that fit (N,)."""
    time = track.time
    N = len(time)
    n = int(np.clip(np.round(2.0 * ARC_START_REACH / np.median(np.diff(time))) + 1, 7, N))
    first = np.clip(np.arange(N) - n // 2, 0, N - n)
    near = first[:, None] + np.arange(n)
    scale = np.max(np.abs(time[near] - time[:, None]), axis=1)
    t = (time[near] - time[:, None]) / scale[:, None]
    powers = t[:, :, None] ** np.arange(4)
    turned = logarithm(product(track.quaternion[near], inverse(track.quaternion)[:, None, :]))
    values = np.concatenate([track.p[near] - track.p[:, None], turned], axis=2)
    inverse_powers = np.linalg.pinv(powers)
    coefficients = inverse_powers @ values
    misfit = np.sum(((values - powers @ coefficients) / noise.std) ** 2, axis=(1, 2))
    value, slope = coefficients[:, 0], coefficients[:, 1] / scale[:, None]
    quaternion = product(exponential(value[:, 3:]), track.quaternion)
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return State.of(track.p + value[:, :3], quaternion, slope[:, :3], slope[:, 3:]), misfit
