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

from drake_cafim.diagnosis.felt_innovations import felt_innovations
from drake_cafim.diagnosis.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.rotors import taken_by_rotors
from drake_cafim.diagnosis.stepper import State, advance
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

SEGMENT = 0.5
"""s from one start of the filter to the next."""
DIFFERENCE = 1e-6
RENEWED = 8
"""Samples for which a derivative of the motion serves where nothing is touched: their noise moves it little."""


@dataclass(frozen=True)
class Innovations:
    """Negative log likelihood per sample, (K,) at `time` (K,) s."""

    time: Array
    negative_log_likelihood: Array

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
        stops += [first + stop for stop in (*starts[1:], len(weak.samples.time) - 1)]
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
    for k in range(int(np.max(end - begin))):
        alive = np.flatnonzero(begin + k + 1 <= end)
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
        states[following], covariances[following] = mean[alive, : 2 * n], covariance[alive, : 2 * n, : 2 * n]
    result = []
    for weak, (first, last) in zip(forms, itertools.pairwise(firsts), strict=True):
        own = values[first:last]
        if weak.sensors:
            own = own + felt_innovations(weak, physics, states[first:last], covariances[first:last])
        filtered = np.flatnonzero(np.isfinite(own))
        result.append(Innovations(time[first + filtered], own[filtered]))
    return result


def _absorbed(predicted: Array, P: Array, y: Array, R: Array) -> tuple[Array, Array, Array]:
    """Mean and covariance once `y` (B, H) was seen with noise of variance `R` (H,), and −ln of how likely it was."""
    H = len(R)
    S = P[:, :H, :H] + np.diag(R)
    error = y - predicted[:, :H]
    solved = np.linalg.solve(S, error[..., None])[..., 0]
    unlikely = 0.5 * (np.sum(error * solved, axis=1) + np.linalg.slogdet(2.0 * np.pi * S)[1])
    gain = np.swapaxes(np.linalg.solve(S, P[:, :H, :]), 1, 2)
    updated = P - gain @ P[:, :H, :]
    return predicted + np.einsum("bij,bj->bi", gain, error), 0.5 * (updated + np.swapaxes(updated, 1, 2)), unlikely


def _track(weak: WeakForm, physics: Physics) -> tuple[Array, Array, Array, Array]:
    """Of one recording: time (N,), what is measured (N, H), the effort from each sample on, the contacts' memory."""
    samples = weak.samples
    measured = weak.measurement(physics)
    effort = weak.mean_effort(physics) + taken_by_rotors(weak, physics)
    y = np.concatenate([measured.q, measured.v], axis=1) if samples.velocity_measured else measured.q
    # the contacts remember the recorded motion, not the filtered one: what it forgets is the same
    return samples.time, y, effort, weak.contact_memory(physics)


def _starts(time: Array) -> list[int]:
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first) / SEGMENT))
    return [int(np.searchsorted(time, first + k * SEGMENT - 1e-9)) for k in range(count)]


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
