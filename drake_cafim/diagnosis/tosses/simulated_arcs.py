"""Arcs simulated from given states, against what was measured, in units of the noise."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.flight import Fine, Flights, fly
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.pose_readings import true_times, written, written_slopes
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.state import Moment, State, picked, replaced, stacked
from drake_cafim.diagnosis.tosses.tangent import Tangent
from drake_cafim.dynamics.rotations import inverse, logarithm, product, rotation_matrices
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class Shot:
    """The arcs as `physics` has them from `start` (B)."""

    arcs: Arcs
    noise: PoseNoise
    physics: Physics
    start: State
    flights: Flights

    @classmethod
    def of(cls, arcs: Arcs, noise: PoseNoise, physics: Physics, start: State, memory: Array | None = None) -> "Shot":
        """The arcs simulated; `memory` (B, K, m) is what the contact remembers at their beginnings."""
        times = true_times(physics, arcs.times)
        body = FreeBody(physics)
        flights = fly(body, start, times, arcs.counts, arcs.recording, arcs.names, noise.std, memory)
        return cls(arcs, noise, physics, start, flights)

    def again(self, which: Flags, start: State, memory: Array | None = None) -> "Shot":
        """The shot with the arcs of `which` (B,) simulated again, from `start` (B)."""
        rows = np.flatnonzero(which)
        times = true_times(self.physics, self.arcs.times)[rows]
        counts, recording = self.arcs.counts[rows], self.arcs.recording[rows]
        remembered = None if memory is None else memory[rows]
        flown = fly(self.body, start[rows], times, counts, recording, self.arcs.names, self.noise.std, remembered)
        B, S = self.flights.shape
        places = np.arange(B * S).reshape(B, S)[rows].ravel()
        at_samples = replaced(self.flights.at_samples, places, flown.at_samples)
        new = replace(flown.fine, flight=rows[flown.fine.flight])
        fine = _joined(_kept(self.flights.fine, ~which), new)
        return replace(self, start=picked(which, start, self.start), flights=Flights(at_samples, (B, S), fine))

    def __getitem__(self, which: Flags) -> "Shot":
        """The arcs of `which` (B,) alone."""
        rows, S = np.flatnonzero(which), self.flights.shape[1]
        fine = _kept(self.flights.fine, which)
        fine = replace(fine, flight=np.searchsorted(rows, fine.flight))
        flights = Flights(self.flights.at_samples[np.repeat(which, S)], (len(rows), S), fine)
        return replace(self, arcs=self.arcs[rows], start=self.start[rows], flights=flights)

    @cached_property
    def body(self) -> FreeBody:
        return FreeBody(self.physics)

    @cached_property
    def rows(self) -> Array:
        """(B, S, 6) predicted less measured, white and of unit variance; zero where there is no sample."""
        return self.whitened(self.errors[..., None])[..., 0]

    @cached_property
    def errors(self) -> Array:
        """(B, S, 6) predicted less measured, m and rad."""
        B, S = self.flights.shape
        p, quaternion = written(self.physics, self.arcs, self.flights.at_samples)
        turned = logarithm(product(quaternion, inverse(self.arcs.quaternion.reshape(B * S, 4))))
        return np.concatenate([p - self.arcs.p.reshape(B * S, 3), turned], axis=1).reshape(B, S, 6)

    def whitened(self, errors: Array) -> Array:
        """Errors (B, S, 6, k), m and rad, in units of what the noise adds from sample to sample."""
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
        f = self.flights.fine
        moment = Moment(f.time, self.arcs.recording[f.flight], self.arcs.names)
        return Tangent(self.body, self.flights, true_times(self.physics, self.arcs.times), moment)

    def slopes(self, change: Array) -> Array:
        """Whitened rows (B, S, 6, k) of changes δx (B, S, 12, k) of the states at the samples."""
        return self.whitened(written_slopes(self.physics, self.arcs, change[:, :, :6]))

    @cached_property
    def by_start(self) -> Array:
        """Whitened rows (B, S, 6, 12) by the states that the arcs begin with."""
        B = self.flights.shape[0]
        identity = np.broadcast_to(np.eye(12), (B, 12, 12))
        return self.slopes(self.tangent.propagated(identity, None))

    def recalled(self, body: FreeBody) -> Array:
        """(F, K, m) what the contact of `body` would remember at each step, of the motion that was simulated."""
        f, points = self.flights.fine, body.touch_points
        memory = np.zeros((len(f.time), points.count, points.memory))
        if points.memory == 0 or body.contact is None:
            return memory
        levers = points.levers(rotation_matrices(f.state.quaternion))
        # an arc goes on where the one before it ended; a recording begins with nothing
        opens = np.append(True, self.arcs.recording[f.flight[1:]] != self.arcs.recording[f.flight[:-1]])
        for k in range(points.count):
            touch = points.touch(f.state, levers[:, :, k], f.mode[:, k] & ~opens)
            memory[:, k] = body.contact.recall(_onwards(f), touch, touch)
        return memory

    def memory_at_start(self, body: FreeBody) -> Array | None:
        """(B, K, m) of `recalled` at the arcs' beginnings."""
        if body.touch_points.memory == 0:
            return None
        f = self.flights.fine
        first = np.searchsorted(f.flight, np.arange(len(self.start)))
        return self.recalled(body)[np.minimum(first, len(f.time) - 1)]


def chosen(first: Flags, one: Shot, other: Shot) -> Shot:
    """The arcs of `one` where `first` (B,) says so, and those of `other` elsewhere."""
    B, S = one.flights.shape
    start = picked(first, one.start, other.start)
    at_samples = picked(np.repeat(first, S), one.flights.at_samples, other.flights.at_samples)
    fine = _joined(_kept(one.flights.fine, first), _kept(other.flights.fine, ~first))
    return Shot(one.arcs, one.noise, one.physics, start, Flights(at_samples, (B, S), fine))


def _kept(fine: Fine, flights: Flags) -> Fine:
    """The steps of these flights (B,)."""
    own = flights[fine.flight]
    return Fine(fine.flight[own], fine.time[own], fine.step[own], fine.state[own], fine.mode[own], fine.memory[own])


def _joined(a: Fine, b: Fine) -> Fine:
    """The steps of both, flight after flight."""
    flight, time, step, mode, memory = (
        np.concatenate([getattr(a, k), getattr(b, k)]) for k in ("flight", "time", "step", "mode", "memory")
    )
    order = np.lexsort((time, flight))
    state = stacked([a.state, b.state])[order]
    return Fine(flight[order], time[order], step[order], state, mode[order], memory[order])


def _onwards(fine: Fine) -> Array:
    """(F,) s of the steps' beginnings, each recording after the other."""
    steps = np.append(0.0, fine.step[:-1])
    return np.asarray(np.cumsum(steps), dtype=float)
