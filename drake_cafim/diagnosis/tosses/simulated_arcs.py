"""Simulation of arcs from given initial states, and its whitened errors against the measured poses."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.flight import Fine, Flights, fly
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.pose_readings import measured_changes, measured_poses, true_times
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.tangent import Tangent
from drake_cafim.dynamics.free_body_state import Moment, State, replace_rows, select, stack
from drake_cafim.dynamics.rotations import inverse, logarithm, product, rotation_matrices
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class Shot:
    """The arcs simulated under `physics` from initial states `start` (B)."""

    arcs: Arcs
    noise: PoseNoise
    physics: Physics
    start: State
    flights: Flights

    @classmethod
    def of(cls, arcs: Arcs, noise: PoseNoise, physics: Physics, start: State, memory: Array | None = None) -> "Shot":
        """Simulates the arcs; `memory` (B, K, m) is the contact's state at their beginnings, None for zero."""
        times = true_times(physics, arcs.times)
        body = FreeBody(physics)
        flights = fly(body, start, times, arcs.counts, arcs.recording, arcs.names, noise.step_std, memory)
        return cls(arcs, noise, physics, start, flights)

    def simulate_again(self, which: Flags, start: State, memory: Array | None = None) -> "Shot":
        """A copy with the arcs of `which` (B,) simulated again, from their states in `start` (B)."""
        rows = np.flatnonzero(which)
        times = true_times(self.physics, self.arcs.times)[rows]
        counts, recording = self.arcs.counts[rows], self.arcs.recording[rows]
        remembered = None if memory is None else memory[rows]
        flights = fly(
            self.body, start[rows], times, counts, recording, self.arcs.names, self.noise.step_std, remembered
        )
        B, S = self.flights.shape
        places = np.arange(B * S).reshape(B, S)[rows].ravel()
        at_samples = replace_rows(self.flights.at_samples, places, flights.at_samples)
        new = replace(flights.fine, flight=rows[flights.fine.flight])
        fine = _merge_steps(_select_flights(self.flights.fine, ~which), new)
        return replace(self, start=select(which, start, self.start), flights=Flights(at_samples, (B, S), fine))

    def __getitem__(self, which: Flags) -> "Shot":
        """The arcs of `which` (B,) alone."""
        rows, S = np.flatnonzero(which), self.flights.shape[1]
        fine = _select_flights(self.flights.fine, which)
        fine = replace(fine, flight=np.searchsorted(rows, fine.flight))
        flights = Flights(self.flights.at_samples[np.repeat(which, S)], (len(rows), S), fine)
        return replace(self, arcs=self.arcs[rows], start=self.start[rows], flights=flights)

    @cached_property
    def body(self) -> FreeBody:
        """The equations of motion of `physics`."""
        return FreeBody(self.physics)

    @cached_property
    def rows(self) -> Array:
        """The whitened errors (B, S, 6), of unit variance; zero where there is no sample or no measured rotation."""
        return self.whiten(self.errors[..., None])[..., 0]

    @cached_property
    def errors(self) -> Array:
        """Predicted minus measured pose (B, S, 6): position, m, and rotation vector, rad, world axes."""
        B, S = self.flights.shape
        p, quaternion = measured_poses(self.physics, self.arcs, self.flights.at_samples)
        turned = logarithm(product(quaternion, inverse(self.arcs.quaternion.reshape(B * S, 4))))
        return np.concatenate([p - self.arcs.p.reshape(B * S, 3), turned], axis=1).reshape(B, S, 6)

    def whiten(self, errors: Array) -> Array:
        """Errors e (B, S, 6, k), m and rad, whitened: (e_s − ρ e_{s−1})/(σ √(1 − ρ²)), ρ = exp(−h/τ); e/σ if white."""
        z = errors / self.noise.std[:, None] * self.arcs.held[:, :, None, None]
        times = self.noise.times
        if not np.any(times > 0.0):
            return np.asarray(z, dtype=float)
        steps = np.diff(self.arcs.times, axis=1)
        kept = np.zeros((*steps.shape, 6))
        for k in np.flatnonzero(times > 0.0):
            kept[..., k] = np.where(self.arcs.held[:, 1:], np.exp(-steps / times[k]), 0.0)
        white = z.copy()
        white[:, 1:] = (z[:, 1:] - kept[..., None] * z[:, :-1]) / np.sqrt(1.0 - kept[..., None] ** 2)
        return white * self.arcs.held[:, :, None, None]

    @cached_property
    def tangent(self) -> Tangent:
        """The derivatives of the flights."""
        f = self.flights.fine
        moment = Moment(f.time, self.arcs.recording[f.flight], self.arcs.names)
        return Tangent(self.body, self.flights, true_times(self.physics, self.arcs.times), moment)

    def slopes(self, change: Array) -> Array:
        """The change (B, S, 6, k) of the whitened rows by changes δx (B, S, 12, k) of the states at the samples."""
        return self.whiten(measured_changes(self.physics, self.arcs, change[:, :, :6]))

    @cached_property
    def start_jacobian(self) -> Array:
        """∂rows/∂start (B, S, 6, 12) of the whitened rows by the arcs' initial states."""
        B = self.flights.shape[0]
        identity = np.tile(np.eye(12), (B, 1, 1))
        return self.slopes(self.tangent.propagate(identity, None))

    def recall_memory(self, body: FreeBody) -> Array:
        """The memory (F, K, m) of the contact of `body` at each step, had the motion been the simulated one."""
        f, points = self.flights.fine, body.touch_points
        memory = np.zeros((len(f.time), points.count, points.memory))
        if points.memory == 0 or body.contact is None:
            return memory
        levers = points.levers(rotation_matrices(f.state.quaternion))
        # an arc continues the memory of the arc before it; only a recording starts without one
        opens = np.append(True, self.arcs.recording[f.flight[1:]] != self.arcs.recording[f.flight[:-1]])
        for k in range(points.count):
            touch = points.touch(f.state, levers[:, :, k], f.mode[:, k] & ~opens)
            memory[:, k] = body.contact.recall(_elapsed_time(f), touch, touch)
        return memory

    def memory_at_start(self, body: FreeBody) -> Array | None:
        """`recall_memory` at the arcs' beginnings, (B, K, m); None where the contact has no memory."""
        if body.touch_points.memory == 0:
            return None
        f = self.flights.fine
        first = np.searchsorted(f.flight, np.arange(len(self.start)))
        return self.recall_memory(body)[np.minimum(first, len(f.time) - 1)]


def select_arcs(which: Flags, shot: Shot, other: Shot) -> Shot:
    """The arcs of `shot` where `which` (B,) is True, those of `other` elsewhere."""
    B, S = shot.flights.shape
    start = select(which, shot.start, other.start)
    at_samples = select(np.repeat(which, S), shot.flights.at_samples, other.flights.at_samples)
    fine = _merge_steps(_select_flights(shot.flights.fine, which), _select_flights(other.flights.fine, ~which))
    return Shot(shot.arcs, shot.noise, shot.physics, start, Flights(at_samples, (B, S), fine))


def _select_flights(fine: Fine, flights: Flags) -> Fine:
    """The steps of the flights of `flights` (B,)."""
    own = flights[fine.flight]
    return Fine(fine.flight[own], fine.time[own], fine.step[own], fine.state[own], fine.mode[own], fine.memory[own])


def _merge_steps(a: Fine, b: Fine) -> Fine:
    """The steps of both, sorted by flight and time."""
    flight, time, step, mode, memory = (
        np.concatenate([getattr(a, k), getattr(b, k)]) for k in ("flight", "time", "step", "mode", "memory")
    )
    order = np.lexsort((time, flight))
    state = stack([a.state, b.state])[order]
    return Fine(flight[order], time[order], step[order], state, mode[order], memory[order])


def _elapsed_time(fine: Fine) -> Array:
    """The beginning (F,) s of each step, with all flights placed end to end."""
    steps = np.append(0.0, fine.step[:-1])
    return np.asarray(np.cumsum(steps), dtype=float)
