"""Simulation of many short flights at once, each with its own steps, which end at its samples and touch-downs.

The Rosenbrock method of `numerics.rosenbrock`, of order 3 with an embedded error estimate: friction near rest and
dampers are implicit, springs explicit. Which points touch is fixed during a step, so that the
force is smooth within it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.tosses.compiled_flight import simulate_flights
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics import rigid_body as rigid
from drake_cafim.dynamics.free_body_state import Moment, State, stack
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.numerics.rosenbrock import (
    ALPHA,
    CAREFUL,
    EMBEDDED,
    GAMMA,
    LANDED,
    LONGEST,
    MOST_STEPS,
    SHARE,
    SHIFT,
    SHORTEST,
    WEIGHTS,
)
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class Fine:
    """The F steps of all flights, ordered by flight and time; they begin at `time` (F,) s and last `step` (F,) s.

    `flight` (F,) is the index of the flight, `mode` (F, K) which points touch during the step; `state` (F) and `memory`
    (F, K, m) hold at its beginning.
    """

    flight: np.ndarray[Any, np.dtype[np.int64]]
    time: Array
    step: Array
    state: State
    mode: Flags
    memory: Array


@dataclass(frozen=True)
class Flights:
    """The states (B · S) at the samples of B flights, up to S each, and the steps between; `shape` is (B, S)."""

    at_samples: State
    shape: tuple[int, int]
    fine: Fine


def fly(
    body: FreeBody, start: State, times: Array, counts: Any, recording: Any, names: tuple[str, ...],
    std: Array, memory: Array | None = None,
) -> Flights:  # fmt: skip
    """Simulates flights from `start` (B) at times[:, 0] through the first `counts` (B,) of their `times` (B, S) s.

    The integration error is bounded by a share of `std` (6,), the noise of a sample, m and rad. `recording` (B,) is the
    index of each flight's recording among `names`; `memory` (B, K, m) is the contact's initial state at each point.
    States that overflow are NaN.
    """
    B, S = times.shape
    points = body.touch_points
    memory = np.zeros((B, points.count, points.memory)) if memory is None else memory.copy()
    allowed = (CAREFUL if points.memory or points.pulls else SHARE) * std
    if body.plain:
        return _fly_compiled(body, start, memory, times, counts, recording, names, allowed)
    depth, sinking = points.depths(start)
    mode = depth > 0.0
    now, out = State(start.numbers.copy()), np.zeros((B, S, start.numbers.shape[1]))
    out[:, 0] = now.numbers
    time, following = times[:, 0].copy(), np.ones(B, dtype=int)
    usual = np.full(B, 1e-3)
    trail: list[tuple[Any, ...]] = []
    alive = np.flatnonzero(counts > 1)
    for _ in range(MOST_STEPS):
        if len(alive) == 0:
            break
        here, touching, remembered = now[alive], mode[alive], memory[alive]
        moment = Moment(time[alive], recording[alive], names)
        left = times[alive, following[alive]] - moment.time
        R = rotation_matrices(here.quaternion)
        forces = points.forces(here, R, touching, remembered)
        first = body.acceleration_under(here, R, forces, moment)
        lost = ~np.all(np.isfinite(first), axis=1)
        if np.any(lost):
            # the forces overflow: the rest of the flight is not a number
            for row in alive[lost]:
                out[row, following[row] :] = np.nan
            alive = alive[~lost]
            continue
        landing = points.time_to_land(here, R, touching, first)
        step = np.minimum(np.minimum(usual[alive], left), np.maximum(landing, SHORTEST))
        # a remainder below 1e-9 s before a sample is added to this step
        step = np.where(left - step < 1e-9, left, step)
        damping = None if forces is None else body.damping(R, forces)
        ended, error = _step(body, here, touching, remembered, moment, first, damping, step, allowed)
        deep, sinking = points.depths(ended)
        past = np.max(np.where(touching, -np.inf, deep), axis=1, initial=-np.inf) > LANDED
        good = (error < 1.0) & ~past | (step <= SHORTEST)
        grown = np.clip(0.9 * np.maximum(error, 1e-8) ** (-1.0 / 3.0), 0.2, 4.0)
        # a step cut short by a sample or a landing does not limit the next one
        wanted = np.where(
            good, np.maximum(step * grown, np.where(step < usual[alive], usual[alive], 0.0)), step * grown
        )
        wanted = np.where(past & (error < 1.0), 0.5 * step, wanted)
        usual[alive] = np.clip(wanted, SHORTEST, LONGEST)
        rows = alive[good]
        if len(rows) == 0:
            continue
        trail.append((rows, time[rows], step[good], here[good], touching[good], remembered[good]))
        ended = ended[good]
        time[rows] += step[good]
        now.numbers[rows] = ended.numbers
        deep, sinking = deep[good], sinking[good]
        held = touching[good]
        fresh = np.where(held, (deep > 0.0) | (sinking > 0.0), (deep > -1e-8) & (sinking > 0.0))
        if points.memory:
            memory[rows] = remember(body, remembered[good], ended, held, step[good])
        mode[rows] = fresh
        done = np.abs(times[rows, following[rows]] - time[rows]) < 1e-12
        arrived = rows[done]
        time[arrived] = times[arrived, following[arrived]]
        out[arrived, following[arrived]] = now.numbers[arrived]
        following[arrived] += 1
        alive = alive[following[alive] < counts[alive]]
    return Flights(State(out.reshape(B * S, -1)), (B, S), _collect_steps(trail, body))


def _fly_compiled(
    body: FreeBody, start: State, memory: Array, times: Array, counts: Any, recording: Any, names: tuple[str, ...],
    allowed: Array,
) -> Flights:  # fmt: skip
    """`fly` by compiled code, for a body whose forces it knows."""
    numbers, instants = np.ascontiguousarray(start.numbers), np.ascontiguousarray(times)
    moving = (*body.inertial, body.physics.gravity, *body.drag, body.pushes(names))
    at_samples, flight, time, step, state, mode, remembered = simulate_flights(
        numbers,
        memory,
        instants,
        counts,
        np.asarray(recording),
        allowed,
        moving,
        body.touch_points.plane,
        body.touch_points.law,
    )
    fine = Fine(flight, time, step, State(state), mode, remembered)
    return Flights(State(at_samples.reshape(-1, 13)), times.shape, fine)


def remember(
    body: FreeBody, memory: Array, ended: State, mode: Flags, elapsed: Array, which: Flags | None = None
) -> Array:
    """The points' memory (B, K, m) `elapsed` (B,) s later, at the states `ended` (B) then.

    Of the points `which` (B, K), zero for the others; None: all. A point that does not touch keeps no force, only its
    position.
    """
    result = np.zeros_like(memory)
    rows, columns = np.nonzero(np.ones_like(mode) if which is None else which)
    if len(rows) and body.contact is not None:
        lever = body.touch_points.levers(rotation_matrices(ended.quaternion))[rows, :, columns]
        touch = body.touch_points.touch(ended[rows], lever, mode[rows, columns])
        zero = np.zeros(len(rows))
        result[rows, columns] = body.contact.ahead(memory[rows, columns], touch, elapsed[rows], zero)
    return result


def _step(
    body: FreeBody, state: State, mode: Flags, memory: Array, moment: Moment, first: Array, damping: Array | None,
    step: Array, allowed: Array,
) -> tuple[State, Array]:  # fmt: skip
    """The states a step later, and the largest error of each (B,) over `allowed` (6,).

    `first` (B, 6) is the acceleration at the step's beginning and `damping` (B, 6, 6) its slope in (v, ω), None in
    flight.
    """
    h, slopes = step[:, None], np.empty((4, *state.numbers.shape))
    inverse = None if damping is None else np.linalg.inv(np.eye(6) - (GAMMA * h)[:, :, None] * damping)
    at, change = state, first
    for i in range(4):
        if i:
            at = State(rigid.combine_stages(state.numbers, step, ALPHA[i, :i], slopes))
            past = ALPHA[i].sum() * step
            kept = remember(body, memory, at, mode, past, mode) if body.touch_points.memory else memory
            change = body.acceleration(at, mode, kept, Moment(moment.time + past, moment.recording, moment.names))
        if damping is not None and inverse is not None:
            if i:
                change = change + h * (damping @ _weighted_sum(SHIFT[i, :i], slopes)[:, 7:, None])[..., 0]
            change = (inverse @ change[..., None])[..., 0]
        rigid.rates(at.numbers, change, slopes[i])
    ended = State(rigid.combine_stages(state.numbers, step, WEIGHTS, slopes))
    missed = h * _weighted_sum(WEIGHTS - EMBEDDED, slopes)[:, 7:]
    error = (np.abs(missed) / allowed).max(axis=1)
    return ended, np.where(np.isfinite(error), error, 1e6)


def _weighted_sum(shares: Array, slopes: Array) -> Array:
    """Σ shares[i] slopes[i] (B, 13) over the first k of the slopes (4, B, 13), with shares (k,)."""
    k = len(shares)
    return np.asarray((shares @ slopes[:k].reshape(k, -1)).reshape(slopes.shape[1:]))


def _collect_steps(trail: list[tuple[Any, ...]], body: FreeBody) -> Fine:
    """The recorded steps, sorted by flight and time."""
    if not trail:
        empty = np.zeros(0)
        none = State(np.zeros((0, 13)))
        shape = (0, body.touch_points.count, body.touch_points.memory)
        return Fine(np.zeros(0, dtype=int), empty, empty, none, np.zeros(shape[:2], dtype=bool), np.zeros(shape))
    flight, time, step, mode, memory = (np.concatenate([steps[k] for steps in trail]) for k in (0, 1, 2, 4, 5))
    state = stack([steps[3] for steps in trail])
    order = np.lexsort((time, flight))
    return Fine(flight[order], time[order], step[order], state[order], mode[order], memory[order])
