"""The integration of `flight`, compiled, for bodies under weight, drag, pushes and a contact law of `compiled_contact`.

Flags are passed as `bool(0)` and `bool(1)`: for the literals `False` and `True` a function is compiled once more each.
Each body is simulated on its own, so that those in flight do not take the short steps of those in contact. Bodies and
points are laid out as in `rigid`; `body` is a tuple of mass, centre of mass, inertia and the inverse of the spatial
inertia, as in `FreeBody.inertial`, gravity (3,) m/s², the drag coefficient N s²/m² and its point (3,) m, and
`FreeBody.pushes`.
"""

from typing import Any

import numpy as np

from drake_cafim.diagnosis.tosses.compiled_contact import advance_memory, forces
from drake_cafim.dynamics import rigid_body as rigid
from drake_cafim.dynamics.rotations import rotation_matrices_of
from drake_cafim.numerics.compiled import compiled
from drake_cafim.numerics.rosenbrock import (
    ALPHA,
    EMBEDDED,
    GAMMA,
    LANDED,
    LONGEST,
    MOST_STEPS,
    SHIFT,
    SHORTEST,
    WEIGHTS,
)
from drake_cafim.typing import Array, Indices


@compiled
def simulate_flights(
    start: Array, memory: Array, times: Array, counts: Any, recording: Any, allowed: Array, body: Any, plane: Any,
    law: Any,
) -> tuple[Array, Indices, Array, Array, Array, Any, Array]:  # fmt: skip
    """States (B, S, 13) at the samples, and the fields of `Fine` in order: the steps between the samples.

    `start` (B, 13), `memory` (B, K, m), `times` (B, S) s, `counts` and `recording` (B,) are as in `fly`; `allowed` (6,)
    m/s and rad/s is the largest error of v and ω in one step.
    """
    B, S = times.shape
    points, below, normal, height = plane
    out, K, found, room = np.zeros((B, S, 13)), points.shape[1], 0, 64 * (B + 1)
    flight, time_at, taken = np.empty(room, dtype=np.int64), np.empty(room), np.empty(room)
    states, modes = np.empty((room, 13)), np.empty((room, K), dtype=np.bool_)
    memories = np.empty((room, K, memory.shape[2]))
    for b in range(B):
        now, time, following, usual = start[b : b + 1].copy(), times[b, 0], 1, 1e-3
        known = memory[b].copy()
        out[b, 0] = now[0]
        R = _rotation(now)
        deep, sinking = rigid.depths(now, R, points, below, normal, height)
        mode = deep > 0.0
        for _ in range(MOST_STEPS):
            if following >= counts[b]:
                break
            left, touching = times[b, following] - time, np.any(mode)
            when = (time, recording[b])
            first, damping = _acceleration(now, R, mode, known, body, plane, law, when, touching)
            if not (np.all(np.isfinite(first)) and np.all(np.isfinite(damping))):
                # the forces overflow: the rest of the flight is not a number
                out[b, following:] = np.nan
                break
            landing = rigid.time_to_land(now, R, points, deep, sinking, mode, first, normal)[0]
            step = min(usual, left, max(landing, SHORTEST))
            # a remainder below 1e-9 s before a sample is added to this step
            if left - step < 1e-9:
                step = left
            ended, error = _step(now, mode, known, body, plane, law, when, first, damping, touching, step, allowed)
            turned = _rotation(ended)
            deeper, faster = rigid.depths(ended, turned, points, below, normal, height)
            past = False
            for k in range(K):
                past |= not mode[0, k] and deeper[0, k] > LANDED
            good = (error < 1.0 and not past) or step <= SHORTEST
            wanted = step * min(max(0.9 * max(error, 1e-8) ** (-1.0 / 3.0), 0.2), 4.0)
            if past and error < 1.0:
                wanted = 0.5 * step
            elif good and step < usual:
                # a step cut short by a sample or a landing does not limit the next one
                wanted = max(wanted, usual)
            usual = min(max(wanted, SHORTEST), LONGEST)
            if not good:
                continue
            if found == room:
                flight, time_at, taken = _double_length(flight), _double_length(time_at), _double_length(taken)
                states, modes, memories, room = (
                    _double_length(states),
                    _double_length(modes),
                    _double_length(memories),
                    2 * room,
                )
            flight[found], time_at[found], taken[found] = b, time, step
            states[found], modes[found], memories[found] = now[0], mode[0], known
            found += 1
            known = _advance_memories(known, ended, turned, mode, bool(1), step, plane, law)
            now, R, deep, sinking, time = ended, turned, deeper, faster, time + step
            for k in range(K):
                into = sinking[0, k] > 0.0
                mode[0, k] = deep[0, k] > 0.0 or into if mode[0, k] else deep[0, k] > -1e-8 and into
            if abs(times[b, following] - time) < 1e-12:
                time, out[b, following] = times[b, following], now[0]
                following += 1
    return out, flight[:found], time_at[:found], taken[:found], states[:found], modes[:found], memories[:found]


@compiled
def _rotation(state: Array) -> Array:
    """R (1, 3, 3) of a body (1, 13)."""
    R: Array = rotation_matrices_of(np.ascontiguousarray(state[:, 3:7]))
    return R


@compiled
def _double_length(values: Any) -> Any:
    """An array with twice the room, of which the first half holds `values`."""
    return np.concatenate((values, values))


@compiled
def _step(
    state: Array, mode: Any, memory: Array, body: Any, plane: Any, law: Any, when: Any, first: Array, damping: Array,
    touching: bool, step: float, allowed: Array,
) -> tuple[Array, float]:  # fmt: skip
    """The state a step later, and the largest error over `allowed`; see `flight`."""
    h, slopes, at, change = np.full(1, step), np.zeros((4, 1, 13)), state, first
    stiff = np.ascontiguousarray(damping[0])
    inverse = np.ascontiguousarray(np.linalg.inv(np.eye(6) - GAMMA * step * stiff)) if touching else np.eye(6)
    for i in range(4):
        if i:
            at = rigid.combine_stages(state, h, ALPHA[i], slopes)
            turned, past = _rotation(at), step * np.sum(ALPHA[i])
            kept = _advance_memories(memory, at, turned, mode, bool(0), past, plane, law)
            change, _ = _acceleration(at, turned, mode, kept, body, plane, law, (when[0] + past, when[1]), bool(0))
        if touching:
            push = change[0].copy()
            for j in range(i):
                push += step * SHIFT[i, j] * (stiff @ np.ascontiguousarray(slopes[j, 0, 7:]))
            change = (inverse @ push).reshape(1, 6)
        rigid.rates(at, change, slopes[i])
    error = 0.0
    for x in range(6):
        missed = 0.0
        for i in range(4):
            missed += (WEIGHTS[i] - EMBEDDED[i]) * slopes[i, 0, 7 + x]
        error = max(error, abs(step * missed) / allowed[x])
    return rigid.combine_stages(state, h, WEIGHTS, slopes), error if np.isfinite(error) else 1e6


@compiled
def _acceleration(
    state: Array, R: Array, mode: Any, memory: Array, body: Any, plane: Any, law: Any, when: Any, stiff: bool
) -> tuple[Array, Array]:
    """(v̇, ω̇) (1, 6) of a body (1, 13), and if `stiff` their slopes in (v, ω) (1, 6, 6) by the contact, else zero.

    `when` is the time, s, and the index of the recording.
    """
    points, below, normal, height = plane
    mass, center, inertia, inverse, gravity, drag, middle, pushes = body
    wrench, damping = np.zeros((1, 2, 3)), np.zeros((1, 6, 6))
    if np.any(mode):
        rows, columns, lever = rigid.near_points(R, points, below, np.zeros(mode.shape), mode, 0.0)
        touching = np.ones(len(rows), dtype=np.bool_)
        held, rate, slip, position = rigid.contact_kinematics(state[rows], lever, touching, normal, height)
        force, moment, slopes = forces(held, rate, slip, position, state[0, 10:], memory[columns], normal, law)
        rigid.add_forces(wrench, rows, lever, force, moment)
        if stiff:
            along, across, onward, into = slip.copy(), slopes[:, 0].copy(), slopes[:, 1].copy(), slopes[:, 2].copy()
            for e in range(len(rows)):
                along[e] /= max(np.sqrt(np.sum(slip[e] ** 2)), 1e-12)
            damping = rigid.velocity_slopes(R, inverse, rows, lever, along, across, onward, into, normal)
    if drag != 0.0:
        _add_drag(wrench[0], state[0], R[0], drag, middle)
    _add_pushes(wrench[0], R[0], pushes, when)
    return rigid.acceleration(state, R, wrench, mass, center, inertia, inverse, gravity), damping


@compiled
def _add_drag(wrench: Array, state: Array, R: Array, drag: float, middle: Array) -> None:
    """Adds −drag |v| v and its moment at `middle` (3,) m of the body to its wrench (2, 3)."""
    w, lever, v, square = state[10:], np.zeros(3), np.empty(3), 0.0
    for x in range(3):
        for y in range(3):
            lever[x] += R[x, y] * middle[y]
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        v[x] = state[7 + x] + w[y] * lever[z] - w[z] * lever[y]
        square += v[x] * v[x]
    v *= -drag * np.sqrt(square)
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        wrench[0, x] += v[x]
        wrench[1, x] += lever[y] * v[z] - lever[z] * v[y]


@compiled
def _add_pushes(wrench: Array, R: Array, pushes: Any, when: Any) -> None:
    """Adds the pulses of force that act now, and their moments, to the wrench (2, 3)."""
    force, span, whose, place = pushes
    time, recording = when
    for k in range(len(whose)):
        phase = (time - span[k, 0]) / max(span[k, 1] - span[k, 0], 1e-6)
        if not 0.0 < phase < 1.0 or (whose[k] >= 0 and whose[k] != recording):
            continue
        lever = R @ place[k]
        now = np.sin(np.pi * phase) ** 2 * force[k]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            wrench[0, x] += now[x]
            wrench[1, x] += lever[y] * now[z] - lever[z] * now[y]


@compiled
def _advance_memories(
    memory: Array, state: Array, R: Array, mode: Any, everywhere: bool, elapsed: float, plane: Any, law: Any
) -> Array:
    """The points' memory (K, m) `elapsed` s later, for the body's state (1, 13) then.

    Of all points if `everywhere`, else of those that touch; the others' is zero.
    """
    if memory.shape[1] == 0:
        return memory
    points, below, normal, height = plane
    result, every, spinning = np.zeros(memory.shape), np.ones(mode.shape, dtype=np.bool_), np.empty(3)
    rows, columns, lever = rigid.near_points(R, points, below, np.zeros(mode.shape), every if everywhere else mode, 0.0)
    pressing = mode[0, columns]
    held, _, _, position = rigid.contact_kinematics(state[rows], lever, pressing, normal, height)
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        spinning[x] = state[0, 10 + y] * below[z] - state[0, 10 + z] * below[y]
    for e in range(len(columns)):
        k = columns[e]
        advance_memory(memory[k], held[e], pressing[e], position[e], spinning, elapsed, normal, law, result[k])
    return result
