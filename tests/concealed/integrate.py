"""Batched adaptive Cash-Karp 5(4) steps with located events.

Members of a batch have their own time and step. A mode (touching or not, engaged or not) is frozen within a step, and
a step that crosses a mode's boundary is shortened until it ends on it, so that a jump of force is never stepped over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .robots import Array

_A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (3 / 10, -9 / 10, 6 / 5),
    (-11 / 54, 5 / 2, -70 / 27, 35 / 27),
    (1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096),
)
_C = (0.0, 1 / 5, 3 / 10, 3 / 5, 1.0, 7 / 8)
_B5 = (37 / 378, 0.0, 250 / 621, 125 / 594, 0.0, 512 / 1771)
_B4 = (2825 / 27648, 0.0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4)
_WEIGHTS = np.array([_B5])
_ERROR = np.array([_B5]) - np.array([_B4])
_STAGES = [np.array([row]) for row in _A]

Derivative = Callable[[Array, Array, np.ndarray], Array]  # (times (B,), state (B, n), mode (B, m)) -> (B, n)
Boundary = Callable[[Array, Array], Array]  # (times (B,), state (B, n)) -> (B, m), positive in the mode


@dataclass
class Integrator:
    """Advances a batch; keeps each member's last step as the next first guess."""

    derivative: Derivative
    boundary: Boundary | None = None
    tolerance: float = 1e-8
    event_tolerance: float = 1e-11
    smallest: float = 1e-9
    looseness: Array | float = 1.0  # (n,) factor of the tolerance by state

    def __post_init__(self) -> None:
        self._step: Array | None = None
        self._tolerances = self.tolerance * self.looseness
        self._usual: Array = np.zeros(0)  # step before it was cut short to end on an event

    def initial_mode(self, time: Array, state: Array) -> np.ndarray:
        if self.boundary is None:
            return np.zeros((len(state), 0), dtype=bool)
        return self.boundary(time, state) > 0.0

    def advance(
        self, start: Array, stop: Array, state: Array, mode: np.ndarray, rates: Array | None = None
    ) -> tuple[Array, np.ndarray]:
        """State (B, n) and mode (B, m) at `stop` (B,); `rates` (B, n) of the state at `start` if they are known."""
        time, x, mode = start.copy(), state.copy(), mode.copy()
        if self._step is None:
            self._step = np.full(len(time), np.inf)
            self._usual = np.zeros(len(time))
        left = stop - time
        while True:
            step = np.minimum(self._step, left)
            new, error = self._attempt(time, x, mode, step, rates)
            rates = None
            scale = self._tolerances * (1.0 + np.maximum(np.abs(x), np.abs(new)))
            norm = (np.abs(error) / scale).max(axis=1)
            norm = np.where(np.isfinite(norm), norm, 1e9)
            good = (norm <= 1.0) | (step <= self.smallest)
            growth = np.minimum(np.maximum(0.9 * np.maximum(norm, 1e-12) ** -0.2, 0.15), 5.0)
            proposal = np.where(step > 0.0, step * growth, self._step)
            if self.boundary is not None:
                good, proposal, mode = self._events(time, x, new, mode, step, good, proposal)
            full = good & (step >= left)
            x = np.where(good[:, None], new, x)
            time = np.where(good, time + step, time)
            # A step cut short by the interval's end does not say that the next must be short.
            self._step = np.where(
                full & (proposal < self._step) & (norm <= 1.0), np.maximum(proposal, self._step), proposal
            )
            time = np.where(full, stop, time)
            left = np.where(full, 0.0, stop - time)
            if not left.any():
                return x, mode

    def _attempt(
        self, time: Array, x: Array, mode: np.ndarray, step: Array, rates: Array | None
    ) -> tuple[Array, Array]:
        slopes = np.empty((6, *x.shape))
        flat, h = slopes.reshape(6, -1), step[:, None]
        slopes[0] = self.derivative(time, x, mode) if rates is None else rates
        for stage in range(1, 6):
            shift = (_STAGES[stage] @ flat[:stage]).reshape(x.shape)
            slopes[stage] = self.derivative(time + _C[stage] * step, x + h * shift, mode)
        return x + h * (_WEIGHTS @ flat).reshape(x.shape), h * (_ERROR @ flat).reshape(x.shape)

    def _events(
        self, time: Array, x: Array, new: Array, mode: np.ndarray, step: Array, good: np.ndarray, proposal: Array
    ) -> tuple[np.ndarray, Array, np.ndarray]:
        assert self.boundary is not None
        after = self.boundary(time + step, new)
        crossed = ((after > 0.0) != mode) & good[:, None]
        if not crossed.any():
            return good, proposal, mode
        before = self.boundary(time, x)
        far = crossed & (np.abs(after) > self.event_tolerance) & (step > self.smallest)[:, None]
        span = np.where(crossed, after - before, 1.0)
        part = np.where(far, np.clip(-before / np.where(span == 0.0, 1.0, span), 1e-6, 0.999999), np.inf)
        retry = far.any(axis=1)
        good = good & ~retry
        shortest = part.min(axis=1)
        proposal = np.where(retry, np.maximum(step * np.where(retry, shortest, 1.0), self.smallest), proposal)
        self._usual = np.where(retry, np.maximum(self._usual, step), self._usual)
        flip = crossed & ~retry[:, None]
        flipped = flip.any(axis=1)
        # Beyond the event the step before it is a better guess than the sliver that ended on it.
        proposal = np.where(flipped, np.maximum(proposal, self._usual), proposal)
        self._usual = np.where(flipped, 0.0, self._usual)
        return good, proposal, np.where(flip, after > 0.0, mode)
