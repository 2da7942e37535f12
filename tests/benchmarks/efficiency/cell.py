"""A cell of the table: machine, motion, sampling, noise, the effect and what is unknown beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.concealed.excitation import _ramp, multisine
from tests.concealed.robots import Array
from tests.concealed.simulate import Simulation

from .machines import Effect, Machine, Unknown

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class Motion:
    """Of each joint a sum of sines about a centre, and rests: `rests` s at the start of every `period` s."""

    frequencies: tuple[float, ...]
    amplitude: float | tuple[float, ...]
    centres: tuple[float, ...]
    rests: float = 0.0
    period: float = 2.0
    seed: int = 0

    def desired(self, time: Array, member: int) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (N, n)."""
        rng = np.random.default_rng([self.seed, member])
        progress, rate, change = self._progress(time)
        parts = len(self.frequencies)
        q, v, a = (np.zeros((len(time), len(self.centres))) for _ in range(3))
        frequency = np.array(self.frequencies)
        reach = np.broadcast_to(self.amplitude, len(self.centres))
        for j, centre in enumerate(self.centres):
            amplitude = reach[j] * rng.uniform(0.6, 1.0, parts) / parts
            s0, s1, s2 = multisine(progress, amplitude, frequency * rng.uniform(0.9, 1.1, parts), self._phases(rng))
            q[:, j] = centre + s0 - s0[0]
            v[:, j], a[:, j] = s1 * rate, s2 * rate**2 + s1 * change
        return q, v, a

    def _phases(self, rng: np.random.Generator) -> Array:
        return np.asarray(rng.uniform(0.0, 2.0 * np.pi, len(self.frequencies)))

    def _progress(self, time: Array) -> tuple[Array, Array, Array]:
        """The time that passes along the sines, with its two derivatives: none while it rests."""
        if not self.rests:
            return time, np.ones_like(time), np.zeros_like(time)
        whole, part = np.divmod(time, self.period)
        moving = self.period - self.rests
        s, s1, s2 = _ramp(part - self.rests, moving)
        return moving * (whole + s), moving * s1, moving * s2


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one sample, SI; `v` None where no velocity is recorded."""

    q: float
    v: float | None = None
    u: float = 0.0
    force: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True)
class Cell:
    """One line of the table."""

    name: str
    machine: Callable[[], Machine]
    motion: Motion
    step: float
    duration: float
    noise: Noise
    effect: Effect
    unknown: tuple[Unknown, ...]
    recordings: int = 1
    gaps: tuple[tuple[float, float], ...] = ()
    """Intervals s in which q and v are missing; the efforts are known."""
    fed_back: bool = False
    """Whether the controller reads what the encoders show, noise included."""
    bandwidth: float = 6.0

    @property
    def true(self) -> Array:
        """Unknowns, then the effect's numbers (n + k,)."""
        return np.array([*(item.true for item in self.unknown), *self.effect.numbers])

    @property
    def typical(self) -> Array:
        """(n + k,) sizes by which the parameters are displaced."""
        return np.array([*(item.prior_std for item in self.unknown), *map(abs, self.effect.numbers)])

    @property
    def samples(self) -> int:
        return round(self.duration / self.step) + 1

    @property
    def time(self) -> Array:
        return self.step * np.arange(self.samples)

    @property
    def seen(self) -> np.ndarray:
        """(N,) whether q and v are there."""
        found = np.ones(self.samples, dtype=bool)
        for first, last in self.gaps:
            found[(self.time > first) & (self.time < last)] = False
        return found


@dataclass(frozen=True)
class Clean:
    """Noise-free motions: q, v, u (B, N, n) and wrenches (B, N, 6) or None."""

    q: Array
    v: Array
    u: Array
    wrench: Array | None


def draws_of(cell: Cell, number: int) -> Mapping[str, Array]:
    """The noise of the cell's draw `number`, by channel kind: (recordings, N, width)."""
    rng = np.random.default_rng([sum(map(ord, cell.name)), number])
    n = cell.machine().robot.size
    size = (cell.recordings, cell.samples)
    noise = cell.noise
    wrench = np.repeat([noise.force, noise.torque], 3)
    return {
        "q": noise.q * rng.normal(size=(*size, n)),
        "v": (noise.v or 0.0) * rng.normal(size=(*size, n)),
        "u": noise.u * rng.normal(size=(*size, n)),
        "wrench": wrench * rng.normal(size=(*size, 6)),
    }


def moved(cell: Cell, numbers: tuple[int, ...] | None = None) -> list[Clean]:
    """The motions under control: one `Clean` for all draws, or, with noise fed back, one for each of `numbers`."""
    machine, members = cell.machine(), cell.recordings
    each = [cell.motion.desired(cell.time, member) for member in range(members)]
    feed = np.stack([machine.feedforward(*entry) for entry in each])
    desired = [np.stack([entry[k] for entry in each]) for k in range(3)]
    sets = 1 if numbers is None else len(numbers)
    noise_q, noise_v = (np.zeros((sets * members, cell.samples, machine.robot.size)) for _ in range(2))
    if numbers is not None:
        drawn = [draws_of(cell, number) for number in numbers]
        noise_q, noise_v = (np.concatenate([entry[kind] for entry in drawn]) for kind in "qv")
    stiffness, damping = machine.inertia * cell.bandwidth**2, 1.6 * machine.inertia * cell.bandwidth
    wanted_q, wanted_v = (np.tile(x, (sets, 1, 1)) for x in desired[:2])
    feedforward = np.tile(feed, (sets, 1, 1))

    def command(k: int, q: Array, v: Array) -> Array:
        error, rate = wanted_q[:, k] - q - noise_q[:, k], wanted_v[:, k] - v - noise_v[:, k]
        return np.asarray(feedforward[:, k] + stiffness * error + damping * rate)

    simulation, plant = machine.simulation(cell.unknown, cell.true, cell.effect, sets * members)
    motion = simulation.run(np.tile(cell.time, (sets * members, 1)), wanted_q[:, 0], wanted_v[:, 0], command)
    wrench = None
    if plant is not None:
        at = zip(cell.time, motion.q.swapaxes(0, 1), motion.v.swapaxes(0, 1), strict=True)
        wrench = np.stack([wrenches(plant, time, q, v) for time, q, v in at], axis=1)
    parts = [slice(s * members, (s + 1) * members) for s in range(sets)]
    return [Clean(motion.q[p], motion.v[p], motion.u[p], None if wrench is None else wrench[p]) for p in parts]


def wrenches(plant: object, time: float, q: Array, v: Array) -> Array:
    """Readings (B, 6) of a press's sensor."""
    hidden, at = plant.initial_hidden(q), np.full(len(q), time)  # type: ignore[attr-defined]
    mode = plant.boundary(at, q, v, hidden) > 0.0  # type: ignore[attr-defined]
    return np.asarray(plant.wrench(at, q, v, hidden, mode))  # type: ignore[attr-defined]


def recorded(cell: Cell, clean: Clean, number: int) -> list[Recording]:
    """Draw `number` of the cell's recordings."""
    drawn, names = draws_of(cell, number), [joint.name for joint in cell.machine().robot.joints]
    missing = np.where(cell.seen, 0.0, np.nan)
    found = []
    for member in range(cell.recordings):
        columns = {}
        for j, name in enumerate(names):
            columns[f"q.{name}"] = clean.q[member, :, j] + drawn["q"][member, :, j] + missing
            if cell.noise.v is not None:
                columns[f"v.{name}"] = clean.v[member, :, j] + drawn["v"][member, :, j] + missing
            columns[f"u.{name}"] = clean.u[member, :, j] + drawn["u"][member, :, j]
        if clean.wrench is not None:
            for k, axis in enumerate(WRENCH):
                columns[f"wrench.wrist.{axis}"] = clean.wrench[member, :, k] + drawn["wrench"][member, :, k]
        found.append(Recording(f"draw {number}, {member + 1}", cell.time, columns))
    return found


def scene_of(cell: Cell, folder: Path) -> Scene:
    """The scene as a user would write it, in `folder`."""
    machine = cell.machine()
    noise = cell.noise
    channels: dict[str, object] = {"q": {"std": noise.q}, "u": {"std": noise.u, "hold": "zero_order"}}
    if noise.v is not None:
        channels["v"] = {"std": noise.v}
    for name, sensor in machine.sensors.items():
        channels[name] = {**sensor, "std": {"force": noise.force, "torque": noise.torque}}
    scenario = {
        "model": "machine.urdf",
        "gravity": [0.0, 0.0, -9.81],
        "weld": [{"body": "base"}],
        "channels": channels,
        "unknown": [dict(item.entry) for item in cell.unknown],
        "contact": [dict(contact) for contact in machine.contacts],
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.urdf").write_text(machine.urdf)
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario, sort_keys=False))
    return Scene.load(folder / "scenario.yaml")


def replayed(simulation: Simulation, time: Array, q0: Array, v0: Array, u: Array) -> tuple[Array, Array]:
    """Positions and velocities (B, N, n) under the efforts u (B, N, n) from (q0, v0), at time (N,)."""
    motion = simulation.run(np.tile(time, (len(q0), 1)), q0, v0, lambda k, q, v: u[:, k])
    return motion.q, motion.v
