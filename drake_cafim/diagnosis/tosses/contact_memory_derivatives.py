"""How what a contact remembers goes on with the motion, and the motion with it, to first order."""

import numpy as np

from drake_cafim.diagnosis.tosses.flight import Fine, remember
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.state import Moment, State, upright
from drake_cafim.dynamics.rotations import exponential, product, rotation_matrices
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array, Flags

SIZES = (1e-7,) * 3 + (1e-6,) * 3 + (1e-6,) * 3 + (1e-5,) * 3
"""Finite steps of p (m), θ (rad), v (m/s) and ω (rad/s)."""
FINE_SIZES = (1e-12,) * 3 + (1e-11,) * 3 + (1e-8,) * 3 + (1e-7,) * 3
"""The same where a contact remembers: a step may slide by less than 1e-8 m, and its way has a kink at rest."""
SOONER = 1e-8
"""s"""
PART = 1e-11
"""Of the largest of a memory's numbers, their finite step."""


def midway(fine: Fine) -> State:
    """The states (F) in the middle of the steps."""
    ended = _ended(fine)
    return upright(State(0.5 * (fine.state.numbers + ended.numbers)))


def midway_acceleration(body: FreeBody, fine: Fine, moment: Moment, state: State) -> Array:
    """v̇ and ω̇ (F, 6) in the middle of the steps, at `state` (F) there."""
    memory = remember(body, fine.memory, state, fine.mode, 0.5 * fine.step, fine.mode)
    return body.acceleration(state, fine.mode, memory, moment)


def landed_sooner(body: FreeBody, state: State, before: Flags, after: Flags) -> Array:
    """How the memory (E, K m) changes with each second by which the points of `after`, not `before`, land sooner."""
    nothing = np.zeros((len(state), body.touch_points.count, body.touch_points.memory))
    none, moment = np.zeros(len(state)), np.full(len(state), SOONER)
    turned = product(exponential(-SOONER * state.w), state.quaternion)
    then = State.of(state.p - SOONER * state.v, turned, state.v, state.w)
    sooner = remember(body, remember(body, nothing, then, before, none), state, after, moment)
    change = np.where((after & ~before)[:, :, None], sooner - remember(body, nothing, state, before, none), 0.0)
    return np.asarray(change.reshape(len(state), -1) / SOONER)


def _ended(fine: Fine) -> State:
    """The states (F) at the steps' ends; the last of a flight ends nowhere."""
    F = len(fine.time)
    follows = np.append(fine.flight[1:] == fine.flight[:-1], False)
    return fine.state[np.arange(F) + follows]


def _sizes(fine: Fine) -> Array:
    """(m,) finite steps of what a point remembers."""
    largest = np.max(np.abs(fine.memory), axis=(0, 1), initial=0.0)
    return np.asarray(PART * np.where(largest > 0.0, largest, 1.0), dtype=float)


def acceleration_by_memory(body: FreeBody, fine: Fine) -> Array:
    """∂(v̇, ω̇)/∂z (F, 6, K m) in the steps' middles, by the memory at their beginnings."""
    contact, state = body.contact, midway(fine)
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

    def pushed(memory: Array) -> Array:
        ahead = contact.ahead(memory, touch, 0.5 * fine.step[rows], np.zeros(len(rows)))
        force, torque = contact.force(touch, ahead)
        wrench = np.concatenate([force, cross(lever, force) + torque], axis=1)
        return np.asarray((inverse @ wrench[:, :, None])[..., 0])

    memory = fine.memory[rows, columns]
    here = pushed(memory)
    for k, size in enumerate(_sizes(fine)):
        other = memory.copy()
        other[:, k] += size
        result[rows, :, columns, k] = (pushed(other) - here) / size
    return result.reshape(len(fine.time), 6, -1)


def memory_slopes(body: FreeBody, fine: Fine) -> tuple[Array, Array]:
    """∂z₊/∂z (F, K, m, m), each point's by its own, and ∂z₊/∂x₊ (F, K m, 12), where it touches or is about to."""
    F, points, m = fine.memory.shape
    ended, asked = _ended(fine), fine.mode | np.roll(fine.mode, -1, axis=0)
    here = remember(body, fine.memory, ended, fine.mode, fine.step, asked)
    kept = np.zeros((F, points, m, m))
    for k, size in enumerate(_sizes(fine)):
        memory = fine.memory.copy()
        memory[:, :, k] += size
        kept[..., k] = (remember(body, memory, ended, fine.mode, fine.step, asked) - here) / size
    pushed = np.zeros((F, points, m, 12))
    for k, size in enumerate(FINE_SIZES):
        change = remember(body, fine.memory, shifted(ended, k, size), fine.mode, fine.step, asked) - here
        pushed[..., k] = change / size
    return kept, pushed.reshape(F, points * m, 12)


def shifted(state: State, k: int, size: float) -> State:
    """The states with the k-th of their twelve numbers changed."""
    numbers = state.numbers.copy()
    if 3 <= k < 6:
        step = np.zeros(3)
        step[k - 3] = size
        numbers[:, 3:7] = product(exponential(step), state.quaternion)
    else:
        numbers[:, k if k < 3 else k + 1] += size
    return State(numbers)
