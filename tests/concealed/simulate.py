"""Simulates a batch of recordings of a controlled robot: plant, concealed effects, controller and clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .integrate import Integrator
from .laws import Drive, Laws
from .robots import Array


class Plant(Protocol):
    """Accelerations of a batch of robots; `hidden` states of its own (bristles, relaxing forces)."""

    hidden: int

    def acceleration(
        self, t: Array, q: Array, v: Array, z: Array, mode: np.ndarray, tau: Array
    ) -> tuple[Array, Array]: ...
    def boundary(self, t: Array, q: Array, v: Array, z: Array) -> Array: ...
    def initial_hidden(self, q: Array) -> Array: ...


@dataclass(frozen=True)
class Motion:
    """A noise-free batch: time (B, N); q, v, a, u (B, N, n), a and u from their sample on; hidden (B, N, h)."""

    time: Array
    q: Array
    v: Array
    a: Array
    u: Array
    hidden: Array
    mode: np.ndarray  # (B, N, m) of the plant
    acting: Array  # (B, N, n) effort that the drive delivers, without what the joint laws add


Controller = Callable[[int, Array, Array], Array]  # (sample, q (B, n), v (B, n)) -> u (B, n)


class Simulation:
    """State of the batch: q, v (link side), the plant's hidden states, rotors, lags, hidden states of joint laws."""

    def __init__(
        self, plant: Plant, size: int, laws: Laws, rotor_inertia: dict[int, float], tolerance: float = 1e-8
    ) -> None:
        self.plant, self.size, self.laws, self.rotor_inertia = plant, size, laws, rotor_inertia
        lags = [drive for drive in laws.drives if drive.time_constant > 0.0]
        n = size
        self._plant_at = slice(2 * n, 2 * n + plant.hidden)
        column = 2 * n + plant.hidden
        self._rotor_at = {item.joint: column + 2 * i for i, item in enumerate(laws.transmissions)}
        column += 2 * len(laws.transmissions)
        self._lag_at = {id(drive): column + i for i, drive in enumerate(lags)}
        column += len(lags)
        self._law_at = []
        for law in laws.joints:
            self._law_at.append(slice(column, column + law.states))
            column += law.states
        self.columns = column
        self._command: Array = np.zeros((0, n))
        self._delayed: dict[int, Array] = {}
        self._noise: Array | float = 0.0
        self._own_modes = sum(law.boundary is not None for law in laws.joints)
        self._own_modes += 2 * sum(item.boundary is not None for item in laws.transmissions)
        self._boundaries = self._count_boundaries()
        # A drive's lag is felt only through what it moves, whose own error is watched.
        looseness = np.ones(column)
        looseness[list(self._lag_at.values())] = 100.0
        boundary = self._boundary if self._boundaries else None
        self.integrator = Integrator(self._derivative, boundary, tolerance, looseness=looseness)

    def _count_boundaries(self) -> bool:
        return (
            any(law.boundary for law in self.laws.joints)
            or any(item.boundary for item in self.laws.transmissions)
            or self.plant.boundary(*self._probe()).shape[1] > 0
        )

    def _probe(self) -> tuple[Array, Array, Array, Array]:
        copies = getattr(self.plant, "copies", 1)
        q = np.zeros((copies, self.size))
        return np.zeros(copies), q, q, self.plant.initial_hidden(q)

    def _boundary(self, t: Array, x: Array) -> Array:
        n = self.size
        q, v = x[:, :n], x[:, n : 2 * n]
        columns = [self.plant.boundary(t, q, v, x[:, self._plant_at])]
        for law in self.laws.joints:
            if law.boundary is not None:
                columns.append(law.boundary(t, q[:, law.joint], v[:, law.joint])[:, None])
        for item in self.laws.transmissions:
            if item.boundary is not None:
                at = self._rotor_at[item.joint]
                columns.append(item.boundary(x[:, at] - q[:, item.joint]))
        return np.concatenate(columns, axis=1)

    def _acting(self, x: Array) -> Array:
        """Effort (B, n) that the drives deliver."""
        effort = self._command.copy()
        for drive in self.laws.drives:
            value = effort[:, drive.joint]
            if drive.delay > 0.0:
                value = self._delayed[id(drive)]
            if drive.time_constant > 0.0:
                value = x[:, self._lag_at[id(drive)]]
            if drive.static is not None:
                value = drive.static(value)
            effort[:, drive.joint] = value
        return effort

    def _derivative(self, t: Array, x: Array, mode: np.ndarray) -> Array:
        n = self.size
        out = np.zeros(x.shape)
        q, v = x[:, :n], x[:, n : 2 * n]
        plant_modes = mode.shape[1] - self._own_modes
        tau = self._acting(x)
        cursor = plant_modes
        on_joint = np.zeros(tau.shape)
        for law, at in zip(self.laws.joints, self._law_at, strict=True):
            j, z, own = law.joint, x[:, at], None
            if law.boundary is not None:
                own = mode[:, cursor]
                cursor += 1
            on_joint[:, j] += law.torque(t, q[:, j], v[:, j], self._command[:, j], z, own)
            if law.rate is not None:
                out[:, at] = law.rate(t, q[:, j], v[:, j], self._command[:, j], z)
        for item in self.laws.transmissions:
            j, at = item.joint, self._rotor_at[item.joint]
            own = None
            if item.boundary is not None:
                own = mode[:, cursor : cursor + 2]
                cursor += 2
            coupling = item.torque(x[:, at] - q[:, j], x[:, at + 1] - v[:, j], own)
            out[:, at] = x[:, at + 1]
            out[:, at + 1] = (tau[:, j] - coupling) / self.rotor_inertia[j]
            tau[:, j] = coupling
        for drive in self.laws.drives:
            if drive.time_constant > 0.0:
                at = self._lag_at[id(drive)]
                source = self._delayed[id(drive)] if drive.delay > 0.0 else self._command[:, drive.joint]
                out[:, at] = (source - x[:, at]) / drive.time_constant
        out[:, :n] = v
        a, rate = self.plant.acceleration(
            t, q, v, x[:, self._plant_at], mode[:, :plant_modes], tau + on_joint + self._noise
        )
        out[:, n : 2 * n] = a
        out[:, self._plant_at] = rate
        return out

    def _start(self, q: Array, v: Array, u: Array) -> Array:
        n = self.size
        x = np.zeros((len(q), self.columns))
        x[:, :n], x[:, n : 2 * n] = q, v
        x[:, self._plant_at] = self.plant.initial_hidden(q)
        for item in self.laws.transmissions:
            at = self._rotor_at[item.joint]
            x[:, at], x[:, at + 1] = q[:, item.joint] + self._twist(item, u[:, item.joint]), v[:, item.joint]
        for drive in self.laws.drives:
            if drive.time_constant > 0.0:
                x[:, self._lag_at[id(drive)]] = u[:, drive.joint]
        return x

    @staticmethod
    def _twist(item: object, torque: Array) -> Array:
        """The twist at which the coupling holds `torque` at rest, by bisection."""
        low, high = np.full_like(torque, -10.0), np.full_like(torque, 10.0)
        always = np.ones((len(torque), 2), dtype=bool)
        for _ in range(80):
            middle = 0.5 * (low + high)
            reached = item.torque(middle, np.zeros_like(middle), always) < torque  # type: ignore[attr-defined]
            low, high = np.where(reached, middle, low), np.where(reached, high, middle)
        return 0.5 * (low + high)

    def run(
        self, time: Array, q0: Array, v0: Array, controller: Controller, process: Array | None = None, skip: int = 0
    ) -> Motion:
        """The motion from (q0, v0) at time (B, N); before the first sample the first command is taken to have acted.

        `process` (B, N, n) are efforts that nobody knows of; the first `skip` samples are simulated and left out.
        The controller sees the rotor's side of a joint with a transmission.
        """
        members, samples = time.shape
        n = self.size
        u = np.zeros((members, samples, n))
        u[:, 0] = controller(0, q0, v0)
        x = self._start(q0, v0, u[:, 0])
        self._command = u[:, 0]
        mode = self.integrator.initial_mode(time[:, 0], x)
        plant_modes = mode.shape[1] - self._own_modes
        record = np.empty((samples, members, self.columns))
        slope = np.empty((samples, members, n))
        modes = np.empty((samples, members, plant_modes), dtype=bool)
        acting = np.empty((samples, members, n))
        for k in range(samples):
            if k:
                u[:, k] = controller(k, *self._seen(x))
            self._command = u[:, k]
            self._noise = 0.0 if process is None else process[:, k]
            self._delay(time, u, k, time[:, k])
            record[k], modes[k], acting[k] = x, mode[:, :plant_modes], self._acting(x)
            rates = self._derivative(time[:, k], x, mode)
            slope[k] = rates[:, n : 2 * n]
            if k + 1 < samples:
                x, mode = self._interval(time, u, k, x, mode, rates)
        keep = slice(skip, samples)
        record = record.swapaxes(0, 1)[:, keep]
        return Motion(
            time[:, keep] - time[:, skip : skip + 1],
            record[:, :, :n],
            record[:, :, n : 2 * n],
            slope.swapaxes(0, 1)[:, keep],
            u[:, keep],
            record[:, :, self._plant_at],
            modes.swapaxes(0, 1)[:, keep],
            acting.swapaxes(0, 1)[:, keep],
        )

    def _seen(self, x: Array) -> tuple[Array, Array]:
        n = self.size
        q, v = x[:, :n].copy(), x[:, n : 2 * n].copy()
        for joint, at in self._rotor_at.items():
            q[:, joint], v[:, joint] = x[:, at], x[:, at + 1]
        return q, v

    def _interval(
        self, time: Array, u: Array, k: int, x: Array, mode: np.ndarray, rates: Array | None
    ) -> tuple[Array, np.ndarray]:
        """From sample k, where the state's rates are known, to the next; it stops where a delayed command changes."""
        now, end = time[:, k].copy(), time[:, k + 1]
        while True:
            stop = end
            for drive in self.laws.drives:
                if drive.delay > 0.0:
                    stop = np.minimum(stop, self._next_change(time, drive, k, now))
            x, mode = self.integrator.advance(now, stop, x, mode, rates)
            if np.all(stop >= end):
                return x, mode
            now, rates = stop, None
            self._delay(time, u, k, now)

    @staticmethod
    def _next_change(time: Array, drive: Drive, k: int, now: Array) -> Array:
        shifted = time[:, : k + 1] + drive.delay
        later = np.where(shifted > now[:, None] + 1e-12, shifted, np.inf)
        return later[:, max(0, k - 400) :].min(axis=1)

    def _delay(self, time: Array, u: Array, k: int, now: Array) -> None:
        for drive in self.laws.drives:
            if drive.delay > 0.0:
                index = np.array(
                    [
                        np.searchsorted(row[: k + 1], at - drive.delay + 1e-12, side="right") - 1
                        for row, at in zip(time, now, strict=True)
                    ]
                )
                self._delayed[id(drive)] = u[np.arange(len(time)), np.maximum(index, 0), drive.joint]
