"""A model's figures of fit on tosses: likelihood of innovations, and errors of simulations of up to a second."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.predict.forecast import HORIZON, Forecast, window_starts
from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK
from drake_cafim.diagnosis.predict.quality import qualities_of
from drake_cafim.diagnosis.tosses.arc_rows import innovation_mask
from drake_cafim.diagnosis.tosses.arcs import Arcs, arcs_of, arcs_of_pieces
from drake_cafim.diagnosis.tosses.initial_states import fit_initial_states
from drake_cafim.diagnosis.tosses.poses import PoseNoise, PoseTrack, unroll_rotation
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.numerics.computation import compute
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

LOST = 1.0
"""Largest error that counts, m (rad): beyond it the simulation is lost, however far."""


def qualities(groups: Sequence[Sequence[PoseTrack]], noise: PoseNoise, physics: Physics, body: str) -> list[Quality]:
    """The quality of `physics` on each group of tracks; the recordings of all groups are simulated as one batch."""
    tracks = [track for group in groups for track in group]
    likelihoods = compute(lambda: _negative_log_likelihoods(tracks, noise, physics))
    simulated = compute(lambda: toss_forecasts(tracks, noise, physics, body))
    return qualities_of([len(group) for group in groups], likelihoods, simulated)


def _negative_log_likelihoods(tracks: Sequence[PoseTrack], noise: PoseNoise, physics: Physics) -> list[Array]:
    """−ln p of each recording's samples (K,), ln(2πσ²) included; bounded by that of errors of `LOST` m (rad)."""
    arcs = arcs_of(tracks, noise)
    fitted = fit_initial_states(arcs, noise, physics, arcs.start)
    rows = fitted.innovation(fitted.shot.rows[..., None])[0][..., 0]
    own = 0.5 * (np.sum(rows**2, axis=2) + fitted.innovation.spread)
    measured = noise.std[: noise.rows]
    level = float(np.sum(np.log(measured) + 0.5 * np.log(2.0 * np.pi))) + _memory_level(arcs, noise)
    own = np.fmin(own + level, noise.rows * (0.5 * np.log(2.0 * np.pi * LOST**2) + 0.5))
    keep = innovation_mask(arcs)
    return [own[arcs.recording == index][keep[arcs.recording == index]] for index in range(len(tracks))]


def _memory_level(arcs: Arcs, noise: PoseNoise) -> float:
    """½ Σ ln(1 − exp(−2 h/τ)) over channels: the share of correlated noise that is new after a sampling time h."""
    coloured = noise.times > 0.0
    if not np.any(coloured):
        return 0.0
    step = float(np.median(np.diff(arcs.times, axis=1)[arcs.held[:, 1:]]))
    return float(np.sum(0.5 * np.log1p(-np.exp(-2.0 * step / noise.times[coloured]))))


def toss_forecasts(tracks: Sequence[PoseTrack], noise: PoseNoise, physics: Physics, body: str) -> list[Forecast]:
    """Each recording simulated over windows of a second, each from a state fitted to the 50 ms before it.

    Columns are the positions, m, and where rotations were measured `pose.<body>.rotation`, rad, the angle turned since
    the window began; the prediction adds to the measured one the angle between the predicted and the measured
    orientation. A recording that ends within its first 50 ms has a forecast without samples.
    """
    before, windows = [], []
    for index, track in enumerate(tracks):
        for start in window_starts(track.time, HORIZON):
            first = min(int(np.searchsorted(track.time, track.time[start] - LOOK_BACK - 1e-9)), max(start - 8, 0))
            stop = int(np.searchsorted(track.time, track.time[start] + HORIZON + 1e-9, side="right"))
            before.append((index, first, start + 1))
            windows.append((index, first, stop))
    columns = [f"pose.{body}.{part}" for part in ("x", "y", "z", *(["rotation"] if noise.turns_measured else []))]
    if not windows:
        return [_without_samples(track, columns) for track in tracks]
    look_back = arcs_of_pieces(tracks, noise, before)
    initial = fit_initial_states(look_back, noise, physics, look_back.start).shot
    whole = arcs_of_pieces(tracks, noise, windows)
    errors = Shot.of(whole, noise, physics, initial.start, initial.memory_at_start(initial.body)).errors
    errors = np.where(np.isfinite(errors), np.clip(errors, -LOST, LOST), LOST)
    later = whole.held & (np.arange(whole.times.shape[1]) >= (look_back.counts - 1)[:, None])
    result = []
    for index, track in enumerate(tracks):
        own = np.flatnonzero(whole.recording == index)
        if len(own) == 0:
            result.append(_without_samples(track, columns))
            continue
        window = np.concatenate([np.full(int(later[b].sum()), w) for w, b in enumerate(own)])
        missed, p = (np.concatenate([values[b][later[b]] for b in own]) for values in (errors, whole.p))
        predicted = {f"pose.{body}.{axis}": p[:, k] + missed[:, k] for k, axis in enumerate("xyz")}
        measured = {f"pose.{body}.{axis}": p[:, k] for k, axis in enumerate("xyz")}
        if noise.turns_measured:
            turned = np.concatenate([_rotation_angles(whole.quaternion[b][later[b]]) for b in own])
            predicted[f"pose.{body}.rotation"] = turned + np.linalg.norm(missed[:, 3:], axis=1)
            measured[f"pose.{body}.rotation"] = turned
        time = np.concatenate([whole.times[b][later[b]] for b in own])
        result.append(Forecast(track.recording.name, time, window, predicted, measured))
    return result


def _without_samples(track: PoseTrack, columns: Sequence[str]) -> Forecast:
    """The forecast of a recording that is too short for one."""
    nothing = np.zeros(0)
    none = dict.fromkeys(columns, nothing)
    return Forecast(track.recording.name, nothing, np.zeros(0, dtype=int), none, none)


def _rotation_angles(quaternion: Array) -> Array:
    """The angle (N,) rad turned since the first of `quaternion` (N, 4), summed over samples."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(unroll_rotation(quaternion), axis=0), axis=1)))
