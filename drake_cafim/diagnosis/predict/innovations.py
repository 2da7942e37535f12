"""The likelihood of a recording as one-step innovations of a Kalman filter that knows the model.

The state is filtered from what the joints show; what wrench sensors then write is judged by that state.
The filter is started anew every half second from the 50 ms before, so that a wrong model cannot hide in what the
filter has learned; the model has no process noise but that of a measured effort. What is known of the model's unknown
parameters only so far is part of the state, anew each time: a better model must not lose by their luck.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.predict.stepper import State, advance
from drake_cafim.diagnosis.predict.wrench_innovations import wrench_innovations
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

SEGMENT = 0.5
"""s from one start of the filter to the next."""
DIFFERENCE = 1e-6
RENEWED = 8
"""Samples for which a derivative of the motion serves where nothing is touched: their noise moves it little."""


@dataclass(frozen=True)
class Innovations:
    """Negative log likelihood per sample, (K,) at `time` (K,) s.

    `lost` is the first time, s, at which the filter's covariance was no longer one, None where it always was: a model
    whose simulation runs away within half a second says nothing of the samples after that.
    """

    time: Array
    negative_log_likelihood: Array
    lost: float | None = None

    @property
    def mean(self) -> float:
        return float(np.mean(self.negative_log_likelihood))


def innovations(forms: Sequence[WeakForm], physics: Physics, doubts: Sequence[Physics] = ()) -> list[Innovations]:
    """The innovations of each recording's q (v and wrenches, where measured), ln(2πσ²) included; side by side.

    `doubts` are the physics a standard deviation off along each axis of what is not known of the parameters.
    """
    tracks = [_track(weak, physics) for weak in forms]
    time, y, effort, memory = (np.concatenate([track[k] for track in tracks]) for k in range(4))
    firsts = np.cumsum([0, *(len(track[0]) for track in tracks)])
    samples, n = forms[0].samples, forms[0].joints
    begun, index, stops = [], [], []
    for weak, first in zip(forms, firsts, strict=False):
        starts = _starts(weak.samples.time)
        begun += [state_at(weak.samples, weak.measurement(physics), start) for start in starts]
        index += [first + start for start in starts]
        ends = itertools.pairwise([*starts, len(weak.samples.time) - 1])
        stops += [first + _before_gap(weak.samples.time, start, stop) for start, stop in ends]
    mean = np.concatenate([np.stack([b[0] for b in begun]), np.stack([b[1] for b in begun])], axis=1)
    mean = np.concatenate([mean, np.zeros((len(mean), len(doubts)))], axis=1)
    covariance = np.stack([block_diag(_joint_covariance(b[2]), np.eye(len(doubts))) for b in begun])
    names = physics.tree.joint_names
    kinds = ("q", "v") if samples.velocity_measured else ("q",)
    R = np.array([samples.std[f"{kind}.{name}"] ** 2 for kind in kinds for name in names])
    effort_variance = np.array([samples.std[f"u.{name}"] ** 2 for name in names])
    begin, end = np.array(index), np.array(stops)
    values = np.full(len(time), np.nan)
    states, covariances = np.full((len(time), 2 * n), np.nan), np.zeros((len(time), 2 * n, 2 * n))
    transitions = np.tile(np.eye(2 * n + len(doubts)), (len(begin), 1, 1))
    by_efforts = np.zeros((len(begin), 2 * n + len(doubts), n))
    lost_at = np.full(len(time), False)
    for k in range(int(np.max(end - begin))):
        alive = np.flatnonzero(begin + k + 1 <= end)
        if len(alive) == 0:
            break
        now, following = (begin + k)[alive], (begin + k + 1)[alive]
        start = State(mean[alive, :n], mean[alive, n : 2 * n], memory[now])
        duration = time[following] - time[now]
        if physics.contacts or k % RENEWED == 0:
            with_effort = bool(np.any(effort_variance))
            moved, transitions[alive, : 2 * n, : 2 * n], by_efforts[alive, : 2 * n] = _predict(
                physics, start, effort[now], duration, with_effort
            )
        else:
            moved = _advanced(physics, start, effort[now], duration)
        if k % RENEWED == 0:
            for column, doubt in enumerate(doubts):
                change = _advanced(doubt, start, effort[now], duration) - moved
                transitions[alive, : 2 * n, 2 * n + column] = change
        predicted = mean[alive]
        predicted[:, : 2 * n] = moved + np.einsum(
            "bij,bj->bi", transitions[alive, : 2 * n, 2 * n :], mean[alive, 2 * n :]
        )
        transition, by_effort = transitions[alive], by_efforts[alive]
        P = transition @ covariance[alive] @ np.swapaxes(transition, 1, 2)
        P = P + (by_effort * effort_variance) @ np.swapaxes(by_effort, 1, 2)
        mean[alive], covariance[alive], values[following] = _absorbed(predicted, P, y[following], R)
        lost = ~np.isfinite(values[following])
        lost_at[following[lost]], end[alive[lost]] = True, now[lost]
        states[following], covariances[following] = mean[alive, : 2 * n], covariance[alive, : 2 * n, : 2 * n]
    result = []
    for weak, (first, last) in zip(forms, itertools.pairwise(firsts), strict=True):
        own = values[first:last]
        if weak.sensors:
            own = own + wrench_innovations(weak, physics, states[first:last], covariances[first:last])
        filtered, lost = np.flatnonzero(np.isfinite(own)), np.flatnonzero(lost_at[first:last])
        at = float(time[first + lost[0]]) if len(lost) else None
        result.append(Innovations(time[first + filtered], own[filtered], at))
    return result


def _absorbed(predicted: Array, P: Array, y: Array, R: Array) -> tuple[Array, Array, Array]:
    """Mean and covariance once `y` (B, H) was seen with noise of variance `R` (H,), and −ln of how likely it was.

    Of an innovation whose covariance S is not positive, which rounding makes of what ran away, that is NaN.
    """
    H = len(R)
    S = P[:, :H, :H] + np.diag(R)
    error = y - predicted[:, :H]
    sign, log_volume = np.linalg.slogdet(2.0 * np.pi * S)
    known = (sign > 0.0) & np.isfinite(log_volume) & np.all(np.isfinite(error), axis=1)
    S = np.where(known[:, None, None], S, np.eye(H))
    solved = np.linalg.solve(S, error[..., None])[..., 0]
    unlikely = np.where(known, 0.5 * (np.sum(error * solved, axis=1) + log_volume), np.nan)
    gain = np.swapaxes(np.linalg.solve(S, P[:, :H, :]), 1, 2)
    updated = P - gain @ P[:, :H, :]
    return predicted + np.einsum("bij,bj->bi", gain, error), 0.5 * (updated + np.swapaxes(updated, 1, 2)), unlikely


def _track(weak: WeakForm, physics: Physics) -> tuple[Array, Array, Array, Array]:
    """Of one recording: time (N,), what is measured (N, H), the effort from each sample on, the contacts' memory."""
    samples = weak.samples
    measured = weak.measurement(physics)
    effort = weak.mean_effort(physics) + rotor_efforts(weak, physics)
    y = np.concatenate([measured.q, measured.v], axis=1) if samples.velocity_measured else measured.q
    # the contacts remember the recorded motion, not the filtered one: what it forgets is the same
    return samples.time, y, effort, weak.contact_memory(physics)


def _starts(time: Array) -> list[int]:
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first) / SEGMENT))
    # in a gap many segments would begin with the sample after it: one is enough
    own = np.flatnonzero(time >= first - 1e-9)
    segment = np.minimum(np.floor((time[own] - first + 1e-9) / SEGMENT), count - 1)
    return [int(start) for start in own[np.flatnonzero(np.diff(segment, prepend=-1.0) > 0.0)]]


def _before_gap(time: Array, start: int, stop: int) -> int:
    """The last sample from `start` to `stop` that no gap of a whole segment lies before."""
    gaps = np.flatnonzero(np.diff(time[start : stop + 1]) > SEGMENT)
    return start + int(gaps[0]) if len(gaps) else stop


def _joint_covariance(blocks: Array) -> Array:
    """(2n, 2n) from each joint's (2, 2) of position and velocity."""
    n = len(blocks)
    result = np.zeros((2 * n, 2 * n))
    for j, block in enumerate(blocks):
        result[np.ix_([j, n + j], [j, n + j])] = block
    return result


def _advanced(physics: Physics, start: State, effort: Array, duration: Array) -> Array:
    """The state one sample on, (B, 2n)."""
    end = advance(physics, start, effort, duration)
    return np.concatenate([end.q, end.v], axis=1)


def _predict(
    physics: Physics, start: State, effort: Array, duration: Array, with_effort: bool
) -> tuple[Array, Array, Array]:
    """The state one sample on, (B, 2n), its derivative by the state (B, 2n, 2n) and by the effort (B, 2n, n)."""
    n = start.q.shape[1]
    mean = np.concatenate([start.q, start.v], axis=1)
    shifts = np.concatenate([np.zeros((1, 2 * n)), DIFFERENCE * np.eye(2 * n), np.zeros((n * with_effort, 2 * n))])
    pushes = np.concatenate([np.zeros((1 + 2 * n, n)), 1e-3 * np.eye(n)[: n * with_effort]])
    copies = len(shifts)
    x = (mean[None] + shifts[:, None]).reshape(-1, 2 * n)
    u = (effort[None] + pushes[:, None]).reshape(-1, n)
    memory = None if start.memory is None else np.tile(start.memory, (copies, 1))
    end = _advanced(physics, State(x[:, :n], x[:, n:], memory), u, np.tile(duration, copies))
    moved = end.reshape(copies, len(mean), 2 * n)
    transition = np.moveaxis(moved[1 : 1 + 2 * n] - moved[0], 0, -1) / DIFFERENCE
    by_effort = np.zeros((len(mean), 2 * n, n))
    if with_effort:
        by_effort = np.moveaxis(moved[1 + 2 * n :] - moved[0], 0, -1) / 1e-3
    return moved[0], transition, by_effort
