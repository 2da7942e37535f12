"""Derivatives of a contact's memory by the motion and by itself, and of the acceleration by the memory."""

import numpy as np

from drake_cafim.diagnosis.tosses.flight import Fine, remember
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics.free_body_state import Moment, State, normalise
from drake_cafim.dynamics.rotations import exponential, product, rotation_matrices
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array, Flags

SIZES = (1e-7,) * 3 + (1e-6,) * 3 + (1e-6,) * 3 + (1e-5,) * 3
"""Finite steps of p (m), θ (rad), v (m/s) and ω (rad/s)."""
FINE_SIZES = (1e-12,) * 3 + (1e-11,) * 3 + (1e-8,) * 3 + (1e-7,) * 3
"""The same where a contact has a memory: a step may slide by less than 1e-8 m, and its path has a kink at rest."""
SOONER = 1e-8
"""Finite step of the time of a touch-down, s."""
PART = 1e-11
"""Finite step of a memory's number, as a share of its largest value."""


def middle_states(fine: Fine) -> State:
    """The states (F) in the middle of the steps, as means of both ends."""
    ended = _end_states(fine)
    return normalise(State(0.5 * (fine.state.numbers + ended.numbers)))


def middle_acceleration(body: FreeBody, fine: Fine, moment: Moment, state: State) -> Array:
    """(v̇, ω̇) (F, 6) in the middle of the steps, at `state` (F) there."""
    memory = remember(body, fine.memory, state, fine.mode, 0.5 * fine.step, fine.mode)
    return body.acceleration(state, fine.mode, memory, moment)


def memory_by_landing_time(body: FreeBody, state: State, before: Flags, after: Flags) -> Array:
    """∂memory/∂(time in contact) (E, K m), 1/s, of the points that land: those of `after`, but not of `before`."""
    nothing = np.zeros((len(state), body.touch_points.count, body.touch_points.memory))
    none, moment = np.zeros(len(state)), np.full(len(state), SOONER)
    turned = product(exponential(-SOONER * state.w), state.quaternion)
    then = State.of(state.p - SOONER * state.v, turned, state.v, state.w)
    sooner = remember(body, remember(body, nothing, then, before, none), state, after, moment)
    change = np.where((after & ~before)[:, :, None], sooner - remember(body, nothing, state, before, none), 0.0)
    return np.asarray(change.reshape(len(state), -1) / SOONER)


def _end_states(fine: Fine) -> State:
    """The states (F) at the steps' ends; for the last step of a flight, whose end is not stored, its beginning."""
    F = len(fine.time)
    follows = np.append(fine.flight[1:] == fine.flight[:-1], False)
    return fine.state[np.arange(F) + follows]


def _sizes(fine: Fine) -> Array:
    """Finite steps (m,) of the numbers of a point's memory."""
    largest = np.max(np.abs(fine.memory), axis=(0, 1), initial=0.0)
    return np.asarray(PART * np.where(largest > 0.0, largest, 1.0), dtype=float)


def acceleration_by_memory(body: FreeBody, fine: Fine) -> Array:
    """∂(v̇, ω̇)/∂z (F, 6, K m) in the middle of the steps, z the memory at their beginning."""
    contact, state = body.contact, middle_states(fine)
    rows, columns = np.nonzero(fine.mode)
    result = np.zeros((len(fine.time), 6, *fine.memory.shape[1:]))
    if contact is None or len(rows) == 0:
        return result.reshape(len(fine.time), 6, -1)
    R = rotation_matrices(state.quaternion)
    lever = body.touch_points.levers(R)[rows, :, columns]
    touch = body.touch_points.touch(state[rows], lever, fine.mode[rows, columns])
    turned = np.zeros((len(rows), 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = R[rows]
    inverse = turned @ body.inertial[3] @ np.swapaxes(turned, 1, 2)

    def acceleration(memory: Array) -> Array:
        ahead = contact.ahead(memory, touch, 0.5 * fine.step[rows], np.zeros(len(rows)))
        force, torque = contact.force(touch, ahead)
        wrench = np.concatenate([force, cross(lever, force) + torque], axis=1)
        return np.asarray((inverse @ wrench[:, :, None])[..., 0])

    memory = fine.memory[rows, columns]
    here = acceleration(memory)
    for k, size in enumerate(_sizes(fine)):
        other = memory.copy()
        other[:, k] += size
        result[rows, :, columns, k] = (acceleration(other) - here) / size
    return result.reshape(len(fine.time), 6, -1)


def memory_slopes(body: FreeBody, fine: Fine) -> tuple[Array, Array]:
    """∂z₊/∂z (F, K, m, m) of each point by its own memory, and ∂z₊/∂x₊ (F, K m, 12), over each step.

    For points that touch during the step or the next one; zero for the others.
    """
    F, points, m = fine.memory.shape
    ended, active = _end_states(fine), fine.mode | np.roll(fine.mode, -1, axis=0)
    here = remember(body, fine.memory, ended, fine.mode, fine.step, active)
    kept = np.zeros((F, points, m, m))
    for k, size in enumerate(_sizes(fine)):
        memory = fine.memory.copy()
        memory[:, :, k] += size
        kept[..., k] = (remember(body, memory, ended, fine.mode, fine.step, active) - here) / size
    by_state = np.zeros((F, points, m, 12))
    for k, size in enumerate(FINE_SIZES):
        change = remember(body, fine.memory, shift(ended, k, size), fine.mode, fine.step, active) - here
        by_state[..., k] = change / size
    return kept, by_state.reshape(F, points * m, 12)


def shift(state: State, k: int, size: float) -> State:
    """The states with the k-th component of δx = (δp, δθ, δv, δω) equal to `size`."""
    numbers = state.numbers.copy()
    if 3 <= k < 6:
        step = np.zeros(3)
        step[k - 3] = size
        numbers[:, 3:7] = product(exponential(step), state.quaternion)
    else:
        numbers[:, k if k < 3 else k + 1] += size
    return State(numbers)
