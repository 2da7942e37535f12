"""The likelihood of a recording as one-step innovations of an extended Kalman filter of the model.

The state (q, v) is filtered from the joints' samples; the likelihood of wrench sensors is taken given that state. With
the innovation e of a sample and its covariance S, a sample adds

    −ln p = ½ (eᵀ S⁻¹ e + ln det(2π S)).

The filter restarts every half second from the state of the 50 ms before, so that a wrong model cannot hide behind what
the filter has adapted to. The only process noise is that of a measured effort. The remaining uncertainty of the model's
unknown parameters is appended to the state at each restart: otherwise a model with better physics could score worse
only because its parameters are uncertain.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.predict.servo_input import ServoInput, goals_of, joined, servo_input
from drake_cafim.diagnosis.predict.servo_memory import remembering
from drake_cafim.diagnosis.predict.stepper import State, advance, advance_each
from drake_cafim.diagnosis.predict.wrench_innovations import wrench_innovations
from drake_cafim.diagnosis.rows.weak_form import WeakForm, memory_of
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

SEGMENT = 0.5
"""Time from one start of the filter to the next, s."""
DIFFERENCE = 1e-6
"""Step of finite differences of q, rad (m), and v, rad/s (m/s)."""
RENEWED = 8
"""Number of samples for which the changes by unknown parameters are reused, and the transition matrix where nothing
acts whose slope changes at once."""


@dataclass(frozen=True)
class Innovations:
    """Negative log likelihood of each sample, (K,) at `time` (K,) s.

    `lost` is the first time, s, at which an innovation was not finite or its covariance not positive definite, None
    where that never happened. The simulation has then run away, and the rest of that half second is left out.
    """

    time: Array
    negative_log_likelihood: Array
    lost: float | None = None

    @property
    def mean(self) -> float:
        """The mean over samples."""
        return float(np.mean(self.negative_log_likelihood))


def innovations(
    forms: Sequence[WeakForm], physics: Physics, doubts: Sequence[Physics] = (), off: float = 1.0
) -> list[Innovations]:
    """The likelihood of each recording's q, and of v and wrenches where measured, ln(2πσ²) included.

    `doubts` is the uncertainty of the fitted parameters: the physics with the parameters moved by `off` standard
    deviations along each of independent directions. All segments of all recordings are filtered as one batch.
    """
    parts = _Segments.of(forms, physics)
    time, y, effort, memory, servo = parts.time, parts.y, parts.effort, parts.memory, parts.servo
    samples, n = forms[0].samples, forms[0].joints
    mean = np.concatenate([parts.mean, np.zeros((len(parts.mean), len(doubts)))], axis=1)
    covariance = np.stack([block_diag(own, np.eye(len(doubts))) for own in parts.covariance])
    names = physics.tree.joint_names
    kinds = ("q", "v") if samples.velocity_measured else ("q",)
    R = np.array([samples.std[f"{kind}.{name}"] ** 2 for kind in kinds for name in names])
    effort_variance = np.array([samples.std[f"u.{name}"] ** 2 for name in names])
    begin, end = parts.begin, parts.end.copy()
    values = np.full(len(time), np.nan)
    states, covariances = np.full((len(time), 2 * n), np.nan), np.zeros((len(time), 2 * n, 2 * n))
    transitions = np.tile(np.eye(2 * n + len(doubts)), (len(begin), 1, 1))
    by_efforts = np.zeros((len(begin), 2 * n + len(doubts), n))
    lost_at = np.full(len(time), False)
    # a joint that slides is carried on quite differently from one that dry friction holds, or a servo at its limit
    renewed = 1 if physics.contacts or physics.joint_forces or servo is not None else RENEWED
    for k in range(int(np.max(end - begin))):
        alive = np.flatnonzero(begin + k + 1 <= end)
        if len(alive) == 0:
            break
        now, following = (begin + k)[alive], (begin + k + 1)[alive]
        start = State(mean[alive, :n], mean[alive, n : 2 * n], memory[now])
        duration = time[following] - time[now]
        asked = servo.at(now) if servo is not None else None
        if k % renewed == 0:
            with_effort = bool(np.any(effort_variance))
            moved, transitions[alive, : 2 * n, : 2 * n], by_efforts[alive, : 2 * n] = _predict(
                physics, start, effort[now], duration, with_effort, asked
            )
        else:
            moved = _advance(physics, start, effort[now], duration, asked)
        if doubts and k % RENEWED == 0:
            for column, later in enumerate(advance_each(doubts, start, effort[now], duration, asked)):
                change = np.concatenate([later.q, later.v], axis=1) - moved
                transitions[alive, : 2 * n, 2 * n + column] = change / off
        predicted = mean[alive]
        predicted[:, : 2 * n] = moved + np.einsum(
            "bij,bj->bi", transitions[alive, : 2 * n, 2 * n :], mean[alive, 2 * n :]
        )
        transition, by_effort = transitions[alive], by_efforts[alive]
        P = transition @ covariance[alive] @ np.swapaxes(transition, 1, 2)
        P = P + (by_effort * effort_variance) @ np.swapaxes(by_effort, 1, 2)
        mean[alive], covariance[alive], values[following] = _update(predicted, P, y[following], R)
        lost = ~np.isfinite(values[following])
        lost_at[following[lost]], end[alive[lost]] = True, now[lost]
        states[following], covariances[following] = mean[alive, : 2 * n], covariance[alive, : 2 * n, : 2 * n]
    result = []
    for weak, (first, last) in zip(forms, itertools.pairwise(parts.firsts), strict=True):
        own = values[first:last]
        if weak.sensors:
            own = own + wrench_innovations(weak, physics, states[first:last], covariances[first:last])
        filtered, lost = np.flatnonzero(np.isfinite(own)), np.flatnonzero(lost_at[first:last])
        at = float(time[first + lost[0]]) if len(lost) else None
        result.append(Innovations(time[first + filtered], own[filtered], at))
    return result


@dataclass(frozen=True)
class _Segments:
    """Segments of recordings: their samples, one recording after another, and the state at each segment's start."""

    time: Array
    """(N,) s."""
    y: Array
    """(N, H) measurements."""
    effort: Array
    """(N, n) mean to the next sample."""
    memory: Array
    """(N, m) of contacts and of friction."""
    servo: ServoInput | None
    firsts: Indices
    """The first sample of each recording, and the number of all."""
    begin: Indices
    end: Indices
    """(S,) first and last samples."""
    mean: Array
    """(S, 2n) states at the first ones."""
    covariance: Array
    """(S, 2n, 2n) of these."""

    @classmethod
    def of(cls, forms: Sequence[WeakForm], physics: Physics) -> "_Segments":
        tracks = [_track(weak, physics) for weak in forms]
        driving = any(weak.samples.commands for weak in forms)
        servo = joined([_servo_input(weak, physics) for weak in forms]) if driving else None
        if servo is not None:
            # behind a delay or a lag it follows the recorded motion
            servo.on[:, list(remembering(physics))] = 0.0
        firsts = np.cumsum([0, *(len(track[0]) for track in tracks)])
        initial, begin, stops = [], [], []
        for weak, first in zip(forms, firsts, strict=False):
            starts = _starts(weak.samples.time)
            initial += [state_at(weak.samples, weak.measurement(physics), start) for start in starts]
            begin += [first + start for start in starts]
            ends = itertools.pairwise([*starts, len(weak.samples.time) - 1])
            stops += [first + _before_gap(weak.samples.time, start, stop) for start, stop in ends]
        q, v, blocks = zip(*initial, strict=True)
        time, y, effort, memory = (np.concatenate([track[k] for track in tracks]) for k in range(4))
        mean = np.concatenate([np.stack(q), np.stack(v)], axis=1)
        covariance = np.stack([_joint_covariance(own) for own in blocks])
        return cls(time, y, effort, memory, servo, firsts, np.array(begin), np.array(stops), mean, covariance)


def _update(predicted: Array, P: Array, y: Array, R: Array) -> tuple[Array, Array, Array]:
    """The measurement update of a Kalman filter: mean, covariance P, and −ln p of `y` (B, H) with variances `R` (H,).

    −ln p is NaN where the innovation is not finite or rounding has made its covariance S indefinite, which happens
    when a simulation runs away.
    """
    H = len(R)
    S = P[:, :H, :H] + np.diag(R)
    error = y - predicted[:, :H]
    sign, log_volume = np.linalg.slogdet(2.0 * np.pi * S)
    known = (sign > 0.0) & np.isfinite(log_volume) & np.all(np.isfinite(error), axis=1)
    S = np.where(known[:, None, None], S, np.eye(H))
    solved = np.linalg.solve(S, error[..., None])[..., 0]
    surprisal = np.where(known, 0.5 * (np.sum(error * solved, axis=1) + log_volume), np.nan)
    gain = np.swapaxes(np.linalg.solve(S, P[:, :H, :]), 1, 2)
    updated = P - gain @ P[:, :H, :]
    return predicted + np.einsum("bij,bj->bi", gain, error), 0.5 * (updated + np.swapaxes(updated, 1, 2)), surprisal


def _track(weak: WeakForm, physics: Physics) -> tuple[Array, Array, Array, Array]:
    """Time (N,) s, measurements (N, H), mean efforts (N, n) to the next sample and memory (N, m)."""
    samples = weak.samples
    measured = weak.measurement(physics)
    effort = weak.mean_effort(physics)
    for j in samples.commands.keys() - remembering(physics):
        # the servo's effort follows the filtered state
        effort[:, j] = measured.u[:, j]
    effort = effort + rotor_efforts(weak, physics)
    y = np.concatenate([measured.q, measured.v], axis=1) if samples.velocity_measured else measured.q
    # the memory follows the recorded motion, not the filtered one: the two differ by noise alone
    return samples.time, y, effort, memory_of(weak, physics)


def _starts(time: Array) -> list[int]:
    """Sample indices at which the filter starts, `SEGMENT` s apart and `LOOK_BACK` s after the first sample."""
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first) / SEGMENT))
    # all segments that would begin within a gap share the first sample after it: only one of them is kept
    own = np.flatnonzero(time >= first - 1e-9)
    segment = np.minimum(np.floor((time[own] - first + 1e-9) / SEGMENT), count - 1)
    return [int(start) for start in own[np.flatnonzero(np.diff(segment, prepend=-1.0) > 0.0)]]


def _before_gap(time: Array, start: int, stop: int) -> int:
    """The last sample from `start` to `stop` before a gap longer than `SEGMENT`; `stop` where there is none."""
    gaps = np.flatnonzero(np.diff(time[start : stop + 1]) > SEGMENT)
    return start + int(gaps[0]) if len(gaps) else stop


def _joint_covariance(blocks: Array) -> Array:
    """The covariance (2n, 2n) of (q, v) from each joint's covariance (2, 2) of position and velocity."""
    n = len(blocks)
    result = np.zeros((2 * n, 2 * n))
    for j, block in enumerate(blocks):
        result[np.ix_([j, n + j], [j, n + j])] = block
    return result


def _servo_input(weak: WeakForm, physics: Physics) -> ServoInput:
    """The servos' inputs from each sample of a recording to the next."""
    return servo_input(weak, physics, goals_of(weak, physics), _edges(weak.samples.time))


def _edges(time: Array) -> Array:
    """The samples' times and one more, so that each sample begins an interval."""
    return np.append(time, 2.0 * time[-1] - time[-2])


def _advance(physics: Physics, start: State, effort: Array, duration: Array, servo: ServoInput | None = None) -> Array:
    """The state (B, 2n) one sample later."""
    end = advance(physics, start, effort, duration, servo)
    return np.concatenate([end.q, end.v], axis=1)


def _predict(
    physics: Physics, start: State, effort: Array, duration: Array, with_effort: bool, servo: ServoInput | None
) -> tuple[Array, Array, Array]:
    """The state x₊ (B, 2n) one sample later, ∂x₊/∂x (B, 2n, 2n) and ∂x₊/∂u (B, 2n, n), by forward differences.

    ∂x₊/∂u is zero unless `with_effort`.
    """
    n = start.q.shape[1]
    mean = np.concatenate([start.q, start.v], axis=1)
    shifts = np.concatenate([np.zeros((1, 2 * n)), DIFFERENCE * np.eye(2 * n), np.zeros((n * with_effort, 2 * n))])
    pushes = np.concatenate([np.zeros((1 + 2 * n, n)), 1e-3 * np.eye(n)[: n * with_effort]])
    copies = len(shifts)
    x = (mean[None] + shifts[:, None]).reshape(-1, 2 * n)
    u = (effort[None] + pushes[:, None]).reshape(-1, n)
    memory = None if start.memory is None else np.tile(start.memory, (copies, 1))
    repeated = None if servo is None else servo.at(np.tile(np.arange(len(mean)), copies))
    end = _advance(physics, State(x[:, :n], x[:, n:], memory), u, np.tile(duration, copies), repeated)
    moved = end.reshape(copies, len(mean), 2 * n)
    transition = np.moveaxis(moved[1 : 1 + 2 * n] - moved[0], 0, -1) / DIFFERENCE
    by_effort = np.zeros((len(mean), 2 * n, n))
    if with_effort:
        by_effort = np.moveaxis(moved[1 + 2 * n :] - moved[0], 0, -1) / 1e-3
    return moved[0], transition, by_effort
