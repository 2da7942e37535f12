"""How well a model does on tosses: one-step innovations, and simulations of up to a second."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.predict.forecast import HORIZON, Forecast, window_starts
from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK
from drake_cafim.diagnosis.predict.quality import qualities_of
from drake_cafim.diagnosis.tosses.arc_rows import counted
from drake_cafim.diagnosis.tosses.arcs import Arcs, arcs_of, joined_arcs
from drake_cafim.diagnosis.tosses.initial_states import settled_from
from drake_cafim.diagnosis.tosses.poses import PoseNoise, PoseTrack, unrolled
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.numerics.computed import computed
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

LOST = 1.0
"""m (rad) that an error counts at most: a simulation that ran away says no more than that."""


def qualities(groups: Sequence[Sequence[PoseTrack]], noise: PoseNoise, physics: Physics, body: str) -> list[Quality]:
    """Of each group under `physics`; the recordings of all are simulated side by side."""
    tracks = [track for group in groups for track in group]
    likelihoods = computed(lambda: _negative_log_likelihoods(tracks, noise, physics))
    simulated = computed(lambda: toss_forecasts(tracks, noise, physics, body))
    return qualities_of([len(group) for group in groups], likelihoods, simulated)


def _negative_log_likelihoods(tracks: Sequence[PoseTrack], noise: PoseNoise, physics: Physics) -> list[Array]:
    """Of each recording's innovations, ln(2πσ²) included; of a body that was lost, no more is said than that."""
    arcs = arcs_of(tracks, noise)
    settled = settled_from(arcs, noise, physics, arcs.start)
    rows = settled.innovation(settled.shot.rows[..., None])[0][..., 0]
    own = 0.5 * (np.sum(rows**2, axis=2) + settled.innovation.spread)
    level = float(np.sum(np.log(noise.std) + 0.5 * np.log(2.0 * np.pi))) + _memory_level(arcs, noise)
    own = np.fmin(own + level, 6.0 * (0.5 * np.log(2.0 * np.pi * LOST**2) + 0.5))
    keep = counted(arcs)
    return [own[arcs.recording == index][keep[arcs.recording == index]] for index in range(len(tracks))]


def _memory_level(arcs: Arcs, noise: PoseNoise) -> float:
    """½ ln of the share of the noise that a sample does not have from the one before, summed over channels."""
    known = noise.times > 0.0
    if not np.any(known):
        return 0.0
    step = float(np.median(np.diff(arcs.times, axis=1)[arcs.held[:, 1:]]))
    return float(np.sum(0.5 * np.log1p(-np.exp(-2.0 * step / noise.times[known]))))


def toss_forecasts(tracks: Sequence[PoseTrack], noise: PoseNoise, physics: Physics, body: str) -> list[Forecast]:
    """Each recording simulated over windows of a second, each from the 50 ms before it.

    Columns are the positions, m, and `pose.<body>.rotation`, rad: how far the body has turned since the window began,
    to which a prediction adds the angle by which it is turned away.
    """
    before, windows = [], []
    for index, track in enumerate(tracks):
        for start in window_starts(track.time, HORIZON):
            first = min(int(np.searchsorted(track.time, track.time[start] - LOOK_BACK - 1e-9)), max(start - 8, 0))
            stop = int(np.searchsorted(track.time, track.time[start] + HORIZON + 1e-9, side="right"))
            before.append((index, first, start + 1))
            windows.append((index, first, stop))
    look_back = joined_arcs(tracks, noise, before)
    begun = settled_from(look_back, noise, physics, look_back.start).shot
    whole = joined_arcs(tracks, noise, windows)
    errors = Shot.of(whole, noise, physics, begun.start, begun.memory_at_start(begun.body)).errors
    errors = np.where(np.isfinite(errors), np.clip(errors, -LOST, LOST), LOST)
    later = whole.held & (np.arange(whole.times.shape[1]) >= (look_back.counts - 1)[:, None])
    result = []
    for index, track in enumerate(tracks):
        own = np.flatnonzero(whole.recording == index)
        window = np.concatenate([np.full(int(later[b].sum()), w) for w, b in enumerate(own)])
        missed, p = (np.concatenate([values[b][later[b]] for b in own]) for values in (errors, whole.p))
        predicted = {f"pose.{body}.{axis}": p[:, k] + missed[:, k] for k, axis in enumerate("xyz")}
        measured = {f"pose.{body}.{axis}": p[:, k] for k, axis in enumerate("xyz")}
        turned = np.concatenate([_turned(whole.quaternion[b][later[b]]) for b in own])
        predicted[f"pose.{body}.rotation"] = turned + np.linalg.norm(missed[:, 3:], axis=1)
        measured[f"pose.{body}.rotation"] = turned
        time = np.concatenate([whole.times[b][later[b]] for b in own])
        result.append(Forecast(track.recording.name, time, window, predicted, measured))
    return result


def _turned(quaternion: Array) -> Array:
    """(N,) rad that the body has turned since the first of `quaternion` (N, 4)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(unrolled(quaternion), axis=0), axis=1)))
