"""Strength and rivals on the pressing stage: the wrench against the nominal law, the axes against the wrench."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from .arm_case import Settings
from .case import Case, World
from .contact_law import ContactLaw
from .draw_contact import WRENCH
from .noise import ChannelNoise
from .press import NAMES, PressPlant, Stage
from .recursion import followed
from .robots import Array
from .strength import TRAINED, Alternative, Excess, Windows, offsets, secant, true_value
from .strength_arm import TIMES, undone
from .truth import Concealed

CHANNELS = (*WRENCH, *NAMES, *(f"rate of {name}" for name in NAMES))

DEEP = ("sensor_bias", "sensor_gain_error")
"""Faults of an encoder that move the surface by as much as it is pressed, where a slope is not enough."""


class PressRows:
    """Whitened rows: six of the wrench, three of the axes, and v against the rate of q of those."""

    def __init__(self, case: Case) -> None:
        world: World = case.study["world"]  # type: ignore[assignment]
        settings: Settings = case.study["settings"]  # type: ignore[assignment]
        self.stage: Stage = case.study["stage"]  # type: ignore[assignment]
        self.noise: dict[str, ChannelNoise] = case.study["noise"]  # type: ignore[assignment]
        self.entries: list[dict[str, object]] = case.study["entries"]  # type: ignore[assignment]
        self.values: dict[str, float] = case.truth["nominal_parameters_true"]  # type: ignore[assignment]
        self.effects: tuple[Concealed, ...] = world.effects
        known: ContactLaw = case.study["nominal_law"]  # type: ignore[assignment]
        told = {str(entry["parameter"]): true_value(entry, self.values) for entry in self.entries}
        self.law: ContactLaw = replace(known, **told)  # type: ignore[arg-type]
        self.time = world.motion.time[TRAINED]
        self.windows = Windows.over(self.time.shape[1], settings.step)
        self.q = np.stack([world.measured[f"q.{name}"][TRAINED] for name in NAMES], axis=2)
        self.v = np.stack([world.measured[f"v.{name}"][TRAINED] for name in NAMES], axis=2)
        self.a, self.u = world.motion.a[TRAINED], world.motion.u[TRAINED]
        self.read = np.stack([world.measured[f"wrench.wrist.{axis}"][TRAINED] for axis in WRENCH], axis=2)
        self.nominal = self.wrench(self.law)
        self.slopes: dict[tuple[str, int], Array] = {}  # of the wrench with an axis's q and v (B, N, 6)
        self.std = self._noise()
        self._looks: tuple[Excess, list[Alternative]] | None = None

    def wrench(
        self, law: ContactLaw, q: Array | None = None, v: Array | None = None, hidden: Array | None = None
    ) -> Array:
        """Wrench (B, N, 6) that a law predicts at the measured states."""
        q = self.q if q is None else q
        v = self.v if v is None else v
        shape = q.shape[:2]
        plant = PressPlant(self.stage, law, q.shape[0] * q.shape[1])
        q, v, t = q.reshape(-1, 3), v.reshape(-1, 3), self.time.ravel()
        z = np.zeros((len(q), plant.hidden)) if hidden is None else hidden.reshape(len(q), -1)
        mode = plant.boundary(t, q, v, z) > 0.0
        return plant.wrench(t, q, v, z, mode).reshape(*shape, 6)

    def _noise(self) -> Array:
        """Std (B, W, 12): the sensor's own noise and what the noise of q and v does to the prediction."""
        w, w1, _ = self.windows.shape
        flat = self.windows.noise_std(w, replace(self.noise["q"], std=1.0, quantum=0.0)) ** 2 / (
            self.windows.step**2 * (w @ w)
        )
        variance = np.empty((*self.windows.integrate(self.nominal, w).shape[:2], 12))
        through = np.zeros((*self.nominal.shape[:2], 6))
        for axis in range(3):
            for name, size in (("q", 1e-7), ("v", 1e-5)):
                q, v = self.q.copy(), self.v.copy()
                (q if name == "q" else v)[:, :, axis] += size
                slope = self.slopes[name, axis] = (self.wrench(self.law, q, v) - self.nominal) / size
                through += (slope * self.noise[name].declared_std) ** 2
        inside = self.windows.step * self.windows.integrate(through, w**2) * flat
        force = self.windows.noise_std(w, self.noise["force"]) ** 2
        torque = self.windows.noise_std(w, self.noise["torque"]) ** 2
        variance[:, :, :3] = inside[:, :, :3] + force
        variance[:, :, 3:6] = inside[:, :, 3:] + torque
        rate = self.windows.noise_std(w, self.noise["v"]) ** 2 + self.windows.noise_std(w1, self.noise["q"]) ** 2
        variance[:, :, 9:] = rate
        variance[:, :, 6:9] = (self.stage.moved * self.windows.noise_std(w1, self.noise["v"])) ** 2 + force
        return np.sqrt(variance)

    def whiten(self, wrench: Array, axes: Array | None = None, q: Array | None = None, v: Array | None = None) -> Array:
        """Rows (B, W, 12) of wrenches (B, N, 6), axis forces (B, N, 3) and the mismatch of q and v (B, N, 3)."""
        w, w1, _ = self.windows.shape
        axes = np.zeros((*wrench.shape[:2], 3)) if axes is None else axes
        balance = self.windows.integrate(np.concatenate([wrench, axes], axis=2), w)
        rate = np.zeros_like(balance[:, :, :3])
        rate = rate if v is None else rate + self.windows.integrate(self._evenly(v), w)
        rate = rate if q is None else rate + self.windows.integrate(self._evenly(q), w1)
        return np.concatenate([balance, rate], axis=2) / self.std

    def _evenly(self, values: Array) -> Array:
        """Values (B, N, 3) at even times: of rates the windows know no others."""
        if np.allclose(np.diff(self.time, axis=1), self.windows.step, rtol=1e-6, atol=0.0):
            return values
        even = self.windows.step * np.arange(values.shape[1])
        return np.stack([CubicSpline(t, own, axis=0)(t[0] + even) for t, own in zip(self.time, values, strict=True)])

    def excess(self) -> Excess:
        masses = np.cumsum([link.mass for link in self.stage.robot.links][::-1])[::-1]
        axes = self.stage.moved * self.a - self.u - masses * self.stage.robot.gravity - self.read[:, :, :3]
        unknown = []
        for entry in self.entries:
            name = str(entry["parameter"])
            moved = replace(self.law, **{name: float(getattr(self.law, name)) + float(entry["std"])})  # type: ignore[arg-type]
            unknown.append(self.whiten(self.nominal - self.wrench(moved)))
        centres = self.time[:, self.windows.centres()]
        rows = self.whiten(self.read - self.nominal, axes, self.q, self.v)
        return Excess(CHANNELS, rows, np.stack(unknown), centres, offsets(self.entries, self.values))

    def shown_in(self, item: Concealed) -> list[str]:
        place = item.at.split(".")[-1]
        return [place] if place in NAMES else [*WRENCH]

    def alternatives(self, item: Concealed, excess: Excess) -> list[Alternative]:
        """They are the same for every effect, and are kept for the last excess that was asked for."""
        if self._looks is None or self._looks[0] is not excess:
            self._looks = excess, self._alternatives(excess)
        return self._looks[1]

    def _alternatives(self, excess: Excess) -> list[Alternative]:
        found = [Alternative(effect, at, np.stack(spans), count) for effect, at, count, spans in self._named()]
        found.append(Alternative("surface_offset", "wall", secant(excess, self._raised, 1e-6)[None], 1))
        return found + [Alternative(name, at, row[None], 1) for name, at, row in self._encoders(excess)]

    def _raised(self, offset: float) -> Array:
        return self.whiten(self.wrench(replace(self.law, offset=offset)) - self.nominal)

    def _encoders(self, excess: Excess) -> Iterator[tuple[str, str, Array]]:
        """Faults of an axis's own q and v, as the wrench and the other of the two show them."""
        for axis, name in enumerate(NAMES):
            ones = 1e-6 * np.ones_like(self.time)
            for letter, seen in (("q", self.q), ("v", self.v)):
                for effect, change in (("sensor_bias", ones), *undone(self.time, seen[:, :, axis])):
                    shown = self._shown(letter, axis, change)
                    if letter == "q" and effect in DEEP:
                        shown = secant(excess, self._deeper(axis, change), 1e-3)
                    yield effect, f"{letter}.{name}", shown

    def _shown(self, letter: str, axis: int, change: Array) -> Array:
        """Rows that a small change of q or v would take away."""
        only = change[:, :, None] * np.eye(3)[axis]
        wrench = self.slopes[letter, axis] * change[:, :, None]
        if letter == "q":
            return self.whiten(wrench, q=-only)
        return self.whiten(wrench, -self.stage.moved * np.gradient(only, self.windows.step, axis=1), v=-only)

    def _deeper(self, axis: int, change: Array) -> Callable[[float], Array]:
        only = change[:, :, None] * np.eye(3)[axis]
        return lambda amount: self.whiten(
            self.wrench(self.law, q=self.q + amount * only) - self.nominal, q=-amount * only
        )

    def _named(self) -> Iterator[tuple[str, str, int, list[Array]]]:
        """Name, place, number of parameters and rows (B, W, 12) that span it."""
        for effect, at, count, laws in _law_changes(self.law):
            yield effect, at, count, [self.whiten(self.wrench(law) - self.nominal) for law in laws]
        for scale in (0.005, 0.02, 0.08, 0.3):
            yield "contact_viscoelastic_relaxation", "tool/wall", 2, [self._relaxed(scale)]
        for distance in (3e-5, 1e-4, 3e-4, 1e-3):
            yield "contact_presliding", "tool/wall", 1, [self._presliding(distance)]
        slope = np.gradient(self.read, self.windows.step, axis=1)
        for seconds in TIMES:
            yield "sensor_delay", "wrench.wrist", 1, [self._sensor(self._ahead(seconds) - self.read)]
        yield "sensor_lag", "wrench.wrist", 1, [self._sensor(slope)]
        yield "clock_skew", "wrench.wrist", 1, [self._sensor(slope * self.time[:, :, None])]
        turned = [
            np.concatenate([np.cross(self.read[:, :, :3], e), np.cross(self.read[:, :, 3:], e)], axis=2)
            for e in np.eye(3)
        ]
        yield "sensor_misalignment", "wrench.wrist", 3, [self._sensor(change) for change in turned]
        for i, axis in enumerate(WRENCH):
            unit = np.zeros(6)
            unit[i] = 1.0
            ones = np.ones_like(self.read) * unit
            yield "sensor_bias", f"wrench.wrist.{axis}", 1, [self._sensor(ones)]
            yield "sensor_gain_error", f"wrench.wrist.{axis}", 1, [self._sensor(self.read * unit)]
            yield "sensor_drift", f"wrench.wrist.{axis}", 1, [self._sensor(ones * self.time[:, :, None])]

    def _sensor(self, change: Array) -> Array:
        """A change of what the sensor reads: seen against the law and against the axes."""
        return self.whiten(change, -change[:, :, :3])

    def _ahead(self, seconds: float) -> Array:
        """What the sensor reads later (B, N, 6): the undoing of a delay; of a lag it is a multiple of the rate."""
        later = np.minimum(self.time + seconds, self.time[:, -1:])
        return np.stack(
            [
                np.column_stack([np.interp(now, t, column) for column in own.T])
                for now, t, own in zip(later, self.time, self.read, strict=True)
            ]
        )

    def _relaxed(self, time: float) -> Array:
        depth = self.stage.radius - self.stage.tip[2] - self.q[:, :, 2]
        hidden = np.zeros((*depth.shape, ContactLaw.hidden))
        keep = np.where(depth > 0.0, np.exp(-self.windows.step / time), 0.0)
        deeper = np.diff(depth, axis=1, prepend=depth[:, :1])
        hidden[:, :, 2] = followed(keep, keep * self.law.stiffness * 0.1 * deeper)
        law = replace(self.law, relaxing=0.1 * self.law.stiffness, relaxation_time=time)
        return self.whiten(self.wrench(law, hidden=hidden) - self.nominal)

    def _presliding(self, distance: float) -> Array:
        hidden = np.zeros((*self.time.shape, ContactLaw.hidden))
        slide = self.v[:, :-1, :2] * self.windows.step
        path = np.linalg.norm(slide, axis=2, keepdims=True)
        keep = np.exp(-path / distance)
        fed = (1.0 - keep) * slide / np.maximum(path, 1e-15) * distance
        # The first is at rest.
        hidden[:, 1:, :2] = followed(keep[:, :, 0], fed)
        return self.whiten(self.wrench(replace(self.law, presliding=distance), hidden=hidden) - self.nominal)


def _law_changes(law: ContactLaw) -> Iterator[tuple[str, str, int, list[ContactLaw]]]:
    """Changes of the law that need no memory; small ones, as the rows are linear in them."""
    pair = "tool/wall"
    yield "surface_tilt", "wall", 2, [replace(law, tilt=(1e-4, 0.0)), replace(law, tilt=(0.0, 1e-4))]
    yield "contact_nonlinear_stiffness", pair, 1, [replace(law, cubic=0.01 * law.stiffness / 1e-6)]
    yield "contact_hunt_crossley_dissipation", pair, 1, [replace(law, dissipation=0.1)]
    for reach in (3e-4, 1e-3, 3e-3):
        yield "contact_adhesion", pair, 2, [replace(law, adhesion=0.01, adhesion_range=reach)]
    for speed in (0.01, 0.03, 0.06, 0.12):
        yield "contact_stribeck_friction", pair, 2, [replace(law, static=law.friction * 1.01, stribeck_velocity=speed)]
    mu = law.friction
    yield (
        "contact_anisotropic_friction",
        pair,
        3,
        [replace(law, anisotropic=(1.01 * mu, 0.99 * mu, angle)) for angle in (0.0, 0.25 * np.pi)],
    )
