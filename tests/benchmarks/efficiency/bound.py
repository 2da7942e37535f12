"""The Cramér–Rao bound of a cell: Fisher information of the likelihood of whole recordings, by the maker's engine.

A recording is x_(k+1) = f(x_k, u_k, θ), y_k = g(x_k, θ) + noise, from an initial state x_0 of which nothing is known;
where efforts are measured, the effort that acts is u_k − e_k with e_k the noise of what was recorded. The makers' f and
g are linearised by central differences about the noise-free motion. The likelihood of y is that of its innovations in a
Kalman filter (Schweppe, IEEE Trans. Inf. Theory 11(1), 1965) that knows nothing of x_0 and has the noise of u as its
process noise. It is linear: fed with ∂y/∂θ, it gives the innovations' derivatives, whose Gram matrix under their
covariances is the information of θ with x_0 projected out. Recordings add up, and so do the unknowns' priors.

Where no noise drives the motion this is the information of the whole rollout, start and all. An unstable motion's grows
exponentially with its length, while an estimate can only use what is linear over its own errors. So each recording is
cut in halves, each with a free start, until the maker's rollouts are linear over ± 3 σ (see `Bound.bend`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from tests.concealed.robots import Array

from .cell import Cell, Clean, replayed, wrenches

STATE_STEP, EFFORT_STEP, SHARE = 1e-5, 1e-3, 1e-3
"""Displacements of states (rad, rad/s; m, m/s) and efforts (N m; N), and of parameters as a share of their size."""
FREE = (1.0, 10.0)
"""Standard deviations of a free initial position and velocity, m or rad: far beyond what the first samples say."""
COPIES = 2048
"""Joints of one batch of the maker's engine."""


@dataclass(frozen=True)
class Linear:
    """Of one recording: A (N−1, s, s), B (N−1, s, p) by θ, E (N−1, s, n) by u; C (N, m, s), D (N, m, p) of y."""

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array

    def between(self, first: int, end: int) -> Linear:
        """Of the samples from `first` to before `end`."""
        steps, samples = slice(first, end - 1), slice(first, end)
        return Linear(self.A[steps], self.B[steps], self.E[steps], self.C[samples], self.D[samples])


def linearised(cell: Cell, clean: Clean, member: int) -> Linear:
    """The maker's steps from sample to sample about the motion of a recording."""
    q, v, u = clean.q[member], clean.v[member], clean.u[member]
    n, true = q.shape[1], cell.true
    steps = _Steps(cell, q[:-1], v[:-1], u[:-1])
    A, E, B = [], [], []
    for j in range(2 * n):
        push = np.eye(2 * n)[j] * STATE_STEP
        A.append((steps.after(true, push) - steps.after(true, -push)) / (2.0 * STATE_STEP))
    for j in range(n):
        more = np.eye(n)[j] * EFFORT_STEP
        ahead, behind = steps.after(true, effort=more), steps.after(true, effort=-more)
        E.append((ahead - behind) / (2.0 * EFFORT_STEP))
    sizes = SHARE * cell.typical
    for i, size in enumerate(sizes):
        ahead, behind = (steps.after(true + sign * size * np.eye(len(true))[i]) for sign in (1.0, -1.0))
        B.append((ahead - behind) / (2.0 * size))
    kinds = [np.eye(n, 2 * n)] + ([np.eye(n, 2 * n, n)] if cell.noise.v is not None else [])
    C = np.tile(np.concatenate(kinds), (len(q), 1, 1))
    D = np.zeros((len(q), C.shape[1], len(true)))
    if clean.wrench is not None:
        by_state, by_parameter = _wrench_slopes(cell, q, v)
        C, D = np.concatenate([C, by_state], axis=1), np.concatenate([D, by_parameter], axis=1)
    return Linear(*(np.stack(columns, axis=2) for columns in (A, B, E)), C, D)


@dataclass(frozen=True)
class _Steps:
    """One sampling interval from each of many states, in batches of the engine."""

    cell: Cell
    q: Array
    v: Array
    u: Array

    @cached_property
    def _machine(self):  # type: ignore[no-untyped-def]
        return self.cell.machine()

    def after(self, values: Array, push: Array | float = 0.0, effort: Array | float = 0.0) -> Array:
        """States (K, 2n) one step after those pushed by `push`, under efforts that `effort` is added to."""
        n, K = self.q.shape[1], len(self.q)
        x = np.concatenate([self.q, self.v], axis=1) + push
        u = self.u + effort
        copies = min(max(1, COPIES // n), K)
        simulation, _ = self._machine.simulation(self.cell.unknown, values, self.cell.effect, copies)
        out = np.empty((K, 2 * n))
        for first in range(0, K, copies):
            # the last batch is filled with states that are done already
            rows = np.arange(first, first + copies).clip(max=K - 1)
            commands = np.repeat(u[rows, None], 2, axis=1)
            q, v = replayed(simulation, self.cell.time[:2], x[rows, :n], x[rows, n:], commands)
            out[rows] = np.concatenate([q[:, 1], v[:, 1]], axis=1)
        return out


def _wrench_slopes(cell: Cell, q: Array, v: Array) -> tuple[Array, Array]:
    """Derivatives of the sensor's readings by the state (N, 6, 2n) and by θ (N, 6, p)."""
    n, true = q.shape[1], cell.true

    def reading(values: Array, push: Array | float = 0.0) -> Array:
        _, plant = cell.machine().simulation(cell.unknown, values, cell.effect, len(q))
        x = np.concatenate([q, v], axis=1) + push
        return wrenches(plant, 0.0, x[:, :n], x[:, n:])

    step = 1e-8  # m: the depth of contact is a fraction of a millimetre
    pushes = np.eye(2 * n) * step
    by_state = [(reading(true, push) - reading(true, -push)) / (2.0 * step) for push in pushes]
    sizes = SHARE * cell.typical
    moves = np.diag(sizes)
    by_parameter = [(reading(true + m) - reading(true - m)) / (2.0 * s) for m, s in zip(moves, sizes, strict=True)]
    return np.stack(by_state, axis=2), np.stack(by_parameter, axis=2)


def information(linear: Linear, seen: np.ndarray, variance: Array, effort_variance: float) -> Array:
    """Fisher information of θ (p, p) by one recording; `variance` (m,) of one sample of y.

    `seen` (N, m) says which readings are there.
    """
    s, p = linear.B.shape[1:]
    # of each parameter, the part of the state's derivative that the filter has not learned from the readings' so far
    d, found = np.zeros((s, p)), np.zeros((p, p))
    P = np.diag(np.repeat(np.square(FREE), s // 2))
    for k, there in enumerate(seen):
        C = linear.C[k][there]
        if len(C):
            innovation = C @ d + linear.D[k][there]
            R = np.diag(variance[there])
            covariance = C @ P @ C.T + R
            gain = np.linalg.solve(covariance, C @ P).T
            found += innovation.T @ np.linalg.solve(covariance, innovation)
            d = d - gain @ innovation
            keep = np.eye(s) - gain @ C
            # Joseph's form: covariances fall by ten powers of ten at the first samples
            P = keep @ P @ keep.T + gain @ R @ gain.T
        if k < len(linear.A):
            A, E = linear.A[k], linear.E[k]
            d = A @ d + linear.B[k]
            P = A @ P @ A.T + effort_variance * E @ E.T
            P = 0.5 * (P + P.T)
    return found


@dataclass(frozen=True)
class Bound:
    """The bound's covariance (p, p) of unknowns and strengths, and how far whole rollouts are from linear."""

    covariance: Array
    segments: int
    """Into how many parts, each with a free initial state, each recording was cut."""
    bend: float
    """|y(θ + 3σ) − y − 3σ ∂y/∂θ| over |3σ ∂y/∂θ|, whitened, the largest of both signs; NaN with noise of u."""

    @property
    def std(self) -> Array:
        return np.sqrt(np.diag(self.covariance))


LINEAR = 0.2
"""Largest `bend` at which a rollout counts as linear."""


def bound_of(cell: Cell, clean: Clean, position: int) -> Bound:
    """The bound for the cell; rollouts are cut in halves until they are linear along θ's direction at `position`."""
    linear = [linearised(cell, clean, member) for member in range(cell.recordings)]
    variance = _variances(cell, linear[0].C.shape[1])
    seen = np.repeat(cell.seen[:, None], len(variance), axis=1)
    if clean.wrench is not None:
        seen[:, -6:] = True
    segments = 1
    while True:
        cuts = np.linspace(0, cell.samples - 1, segments + 1).astype(int)
        spans = list(pairwise(cuts))
        total = np.diag([*(item.prior_std**-2 for item in cell.unknown), *_priors_of(cell)])
        parts = []
        for own in linear:
            for first, last in spans:
                end = last + (last == cell.samples - 1)
                part = own.between(first, end)
                total = total + information(part, seen[first:end], variance, cell.noise.u**2)
                parts.append(part)
        covariance = np.linalg.inv(total)
        if cell.noise.u > 0.0 or clean.wrench is not None:
            # with process noise no rollout is followed open loop, and at contacts none is long
            return Bound(covariance, segments, float("nan"))
        bend = max(_bend(cell, clean, covariance, position, parts, spans, variance))
        if bend < LINEAR or segments >= 64:
            return Bound(covariance, segments, bend)
        segments *= 2


def _priors_of(cell: Cell) -> list[float]:
    """Inverse variances: nothing is known of a strength, and a width to a factor of ten."""
    width = [] if cell.effect.width is None else [np.log(10.0) ** -2]
    return [*(0.0 for _ in cell.effect.values), *width]


def _variances(cell: Cell, width: int) -> Array:
    n = cell.machine().robot.size
    noise = cell.noise
    kinds = [np.full(n, noise.q), *([np.full(n, noise.v)] if noise.v is not None else [])]
    if width > sum(map(len, kinds)):
        kinds += [np.full(3, noise.force), np.full(3, noise.torque)]
    return np.concatenate(kinds) ** 2


def _bend(
    cell: Cell, clean: Clean, covariance: Array, position: int, parts: list[Linear], spans: list[tuple[int, int]],
    variance: Array,
) -> list[float]:  # fmt: skip
    """How far the maker's rollouts are from linear, three standard deviations along the strength's direction."""
    n, scale = clean.q.shape[2], np.sqrt(variance)
    worst = []
    move = 3.0 * covariance[:, position] / np.sqrt(covariance[position, position])
    for sign in (1.0, -1.0):
        off, size = 0.0, 0.0
        for index, part in enumerate(parts):
            member, (first, _) = index // len(spans), spans[index % len(spans)]
            span = slice(first, first + len(part.C))
            by_start, by_move = _rollout(part, np.eye(2 * n), 0.0), _rollout(part, np.zeros(2 * n), sign * move)
            weights = scale[None, :, None]
            # the initial state that fits best beside the displaced parameters
            matrix, aim = ((part.C @ x.reshape(len(x), 2 * n, -1)) / weights for x in (by_start, by_move))
            start = -np.linalg.lstsq(matrix.reshape(-1, 2 * n), aim.ravel(), rcond=1e-14)[0]
            simulation, _ = cell.machine().simulation(cell.unknown, cell.true + sign * move, cell.effect, 1)
            x = np.concatenate([clean.q[member, first], clean.v[member, first]]) + start
            time = cell.time[span] - cell.time[first]
            q, v = replayed(simulation, time, x[None, :n], x[None, n:], clean.u[member, span][None])
            moved = np.concatenate([q[0] - clean.q[member, span], v[0] - clean.v[member, span]], axis=1)
            line = by_start @ start + by_move
            off += float(np.sum((np.einsum("kms,ks->km", part.C, moved - line) / scale) ** 2))
            size += float(np.sum((np.einsum("kms,ks->km", part.C, line) / scale) ** 2))
        worst.append(float(np.sqrt(off / size)))
    return worst


def _rollout(part: Linear, start: Array, move: Array | float) -> Array:
    """States (N, s, ...) of the linearised rollout from `start` (s, ...), with parameters displaced by `move` (p,)."""
    states = [start]
    for A, B in zip(part.A, part.B, strict=True):
        states.append(A @ states[-1] + (B @ move if isinstance(move, np.ndarray) else 0.0))
    return np.array(states)
