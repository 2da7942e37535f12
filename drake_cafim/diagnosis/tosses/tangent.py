"""First-order derivatives of flights by their initial states and by forces along the way.

Between touch-downs δẋ = J δx + δa with δx = (δp, δθ, δv, δω), θ the small rotation about the world's axes, taken
along the recorded steps by the L-stable Padé approximation (1, 2) of the exponential. At a touch-down the flights
nearby land a little earlier or later, which adds (ẋ₊ − ẋ₋) δd/ḋ (saltation; Leine, Nijmeijer, Dynamics and
Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7). The contact's memory
is propagated together with the state.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.diagnosis.tosses.compiled_tangent import propagate_flights
from drake_cafim.diagnosis.tosses.contact_memory_derivatives import (
    FINE_SIZES,
    SIZES,
    acceleration_by_memory,
    memory_by_landing_time,
    memory_slopes,
    middle_acceleration,
    middle_states,
    shift,
)
from drake_cafim.diagnosis.tosses.flight import Fine, Flights
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics.free_body_state import Moment, State, normalise
from drake_cafim.dynamics.motion import skew
from drake_cafim.dynamics.rotations import exponential, product, rotation_matrices
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array

INSIDE = 2e-6
"""Depth, m, at which a point that has just landed is linearised."""


@dataclass(frozen=True)
class Landings:
    """Touch-downs: the step that each begins, `row` (E,), its `point` (E,), and ∂(state, memory)/∂d `gain` (E, n)."""

    row: np.ndarray[Any, np.dtype[np.int64]]
    point: np.ndarray[Any, np.dtype[np.int64]]
    gain: Array
    by_state: Array
    """∂d/∂x (E, 12)."""


@dataclass(frozen=True)
class Tangent:
    """The derivatives of `flights` of `body` through samples at `times` (B, S) s."""

    body: FreeBody
    flights: Flights
    times: Array
    moment: Moment
    """The times and recordings of the steps' beginnings."""

    @property
    def fine(self) -> Fine:
        """The steps of the flights."""
        return self.flights.fine

    @cached_property
    def follows(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """(F,) whether the next step continues this one with the same points in contact."""
        f = self.fine
        same = (f.flight[1:] == f.flight[:-1]) & np.all(f.mode[1:] == f.mode[:-1], axis=1)
        return np.append(same, False)

    def middle(self, values: Array) -> Array:
        """The mean (F, ...) of values at each step's beginning and end; where the mode changes, the beginning's."""
        ahead = np.concatenate([values[1:], values[-1:]])
        mean = 0.5 * (values + ahead)
        return np.where(self.follows.reshape(-1, *[1] * (values.ndim - 1)), mean, values)

    def acceleration(self, body: FreeBody, memory: Array | None = None) -> Array:
        """(v̇, ω̇) (F, 6) at the steps' beginnings under the law of `body`, on the same states."""
        f = self.fine
        return body.acceleration(f.state, f.mode, f.memory if memory is None else memory, self.moment)

    @property
    def _size(self) -> int:
        """The number of entries of the state's change and of the points' memory together."""
        return 12 + self.body.touch_points.count * self.body.touch_points.memory

    @cached_property
    def landings(self) -> Landings:
        """The touch-downs, with their saltation terms."""
        f = self.fine
        fresh = np.zeros_like(f.mode)
        if len(f.time):
            fresh[1:] = f.mode[1:] & ~f.mode[:-1] & (f.flight[1:] == f.flight[:-1])[:, None]
        row, point = np.nonzero(fresh)
        if len(row) == 0 or self.body.contact is None:
            return Landings(row, point, np.zeros((0, self._size)), np.zeros((0, 12)))
        state, n = f.state[row], self.body.contact.normal
        lever = self.body.touch_points.levers(rotation_matrices(state.quaternion))[np.arange(len(row)), :, point]
        sinking = -np.einsum("ei,i->e", state.v + cross(state.w, lever), n)
        before = f.mode[row].copy()
        before[np.arange(len(row)), point] = False
        after = before.copy()
        after[np.arange(len(row)), point] = True
        jump = self.body.acceleration(state, after, f.memory[row], self.moment[row])
        jump = jump - self.body.acceleration(state, before, f.memory[row], self.moment[row])
        gain = np.zeros((len(row), self._size))
        gain[:, 6:12] = jump / np.maximum(sinking, 1e-3)[:, None]
        if self.body.touch_points.memory:
            sooner = memory_by_landing_time(self.body, state, before, after)
            gain[:, 12:] = sooner / np.maximum(sinking, 1e-3)[:, None]
        by_state = np.zeros((len(row), 12))
        by_state[:, :3] = -n
        by_state[:, 3:6] = -cross(lever, np.broadcast_to(n, lever.shape))
        return Landings(row, point, gain, by_state)

    @cached_property
    def slopes(self) -> Array:
        """J (F, 12, 12) in the middle of each step."""
        f = self.fine
        if self.body.touch_points.memory:
            return self._slopes_midway()
        # a point that has just landed is linearised slightly below the plane, so that no difference leaves contact
        state = f.state
        if self.body.contact is not None:
            pressed = state.p - INSIDE * self.body.contact.normal
            state = State.of(pressed, state.quaternion, state.v, state.w)
        here = self.body.acceleration(state, f.mode, f.memory, self.moment)
        J = np.zeros((len(f.time), 12, 12))
        J[:, :3, 6:9] = J[:, 3:6, 9:] = np.eye(3)
        J[:, 3:6, 3:6] = skew(f.state.w)
        for k, size in enumerate(SIZES):
            moved = self.body.acceleration(shift(state, k, size), f.mode, f.memory, self.moment)
            J[:, 6:, k] = (moved - here) / size
        return self.middle(J)

    def _slopes_midway(self) -> Array:
        """J (F, 12, 12) at mid-step, where contacts have a memory: earlier it lacks the sliding direction."""
        f = self.fine
        state = middle_states(f)
        here = middle_acceleration(self.body, f, self.moment, state)
        J = np.zeros((len(f.time), 12, 12))
        J[:, :3, 6:9] = J[:, 3:6, 9:] = np.eye(3)
        J[:, 3:6, 3:6] = skew(state.w)
        for k, size in enumerate(FINE_SIZES):
            moved_on = middle_acceleration(self.body, f, self.moment, shift(state, k, size))
            J[:, 6:, k] = (moved_on - here) / size
        return J

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """∂x₊/∂x (F, 12, 12) over each step, and ∂x₊/∂a (F, 12, 6) by a constant acceleration during it."""
        hJ = self.fine.step[:, None, None] * self.slopes
        identity = np.eye(12)
        denominator = identity - 2.0 / 3.0 * hJ + hJ @ hJ / 6.0
        forced = (self.fine.step[:, None, None] * (identity - hJ / 6.0))[:, :, 6:]
        both = np.linalg.solve(denominator, np.concatenate([identity + hJ / 3.0, forced], axis=2))
        return both[:, :, :12].copy(), both[:, :, 12:].copy()

    @cached_property
    def _memory(self) -> tuple[Array, Array, Array]:
        """∂x₊/∂z (F, 12, M), ∂z₊/∂z (F, points, m, m) and ∂z₊/∂x₊ (F, M, 12), z all points' memory, M = points m."""
        F = len(self.fine.time)
        if self.body.touch_points.memory == 0:
            return np.zeros((F, 12, 0)), np.zeros((F, 0, 0, 0)), np.zeros((F, 0, 12))
        by_memory = self._steps[1] @ acceleration_by_memory(self.body, self.fine)
        return by_memory, *memory_slopes(self.body, self.fine)

    @cached_property
    def _order(self) -> tuple[Any, Any]:
        """The first step of each flight (B + 1,); the sample at which each step ends (F,), −1 for none."""
        f = self.fine
        B = self.flights.shape[0]
        first = np.searchsorted(f.flight, np.arange(B + 1))
        ends = f.time + f.step
        sample = np.full(len(ends), -1)
        for b in range(B):
            own = slice(first[b], first[b + 1])
            k = np.clip(np.searchsorted(self.times[b], ends[own] - 1e-10), 0, self.times.shape[1] - 1)
            sample[own] = np.where(np.abs(self.times[b][k] - ends[own]) < 1e-9, k, -1)
        return first, sample

    def propagate(self, initial: Array, acceleration: Array | None, deeper: Array | None = None) -> Array:
        """δx (B, S, 12, k) at the samples.

        It follows from δx₀ = `initial` (B, 12, k), from δa = `acceleration` (F, 6, k) at the steps' beginnings, and
        from `deeper` (E, k) m, the change of the points' depths when they land.
        """
        transition, forced = self._steps
        landed, columns = self.landings, initial.shape[2]
        pushes = np.zeros((len(transition), 12, columns))
        if acceleration is not None:
            pushes = forced @ self.middle(acceleration)
        sooner = np.zeros((len(landed.row), columns)) if deeper is None else np.ascontiguousarray(deeper)
        jumps = (landed.row, landed.gain, landed.by_state, sooner)
        start = np.ascontiguousarray(initial, dtype=float)
        found = propagate_flights(start, *self._order, transition, pushes, self._memory, jumps, self.flights.shape)
        return np.asarray(found)


def displace(state: State, change: Array) -> State:
    """The states (B) changed by δx = (δp, δθ, δv, δω) (B, 12)."""
    turned = product(exponential(change[:, 3:6]), state.quaternion)
    return normalise(State.of(state.p + change[:, :3], turned, state.v + change[:, 6:9], state.w + change[:, 9:]))
