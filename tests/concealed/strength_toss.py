"""Strength and rival explanations on tosses: momentum and spin of the tracked pose against the nominal law.

The pose is taken on a grid eight times finer than the samples, because an impact is over in a few of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from .case import Case
from .contact_law import ContactLaw
from .noise import ChannelNoise
from .robots import Array, Link
from .strength import Alternative, Excess, Windows, offsets, true_value
from .toss import Toss
from .toss_case import POSE, _pose_curves
from .truth import Channels, Concealed

CHANNELS = ("x", "y", "z", "rx", "ry", "rz")
_PARTS = 8
_WINDOW = 0.1  # s: a twice differentiated pose says little in less


class TossRows:
    """Whitened rows of the balance of momentum (3) and spin about the body's centre (3)."""

    def __init__(self, case: Case) -> None:
        study = case.study
        true: Toss = study["toss"]  # type: ignore[assignment]
        self.link: Link = study["link"]  # type: ignore[assignment]
        self.effects: tuple[Concealed, ...] = study["effects"]  # type: ignore[assignment]
        self.entries: list[dict[str, object]] = study["entries"]  # type: ignore[assignment]
        self.values: dict[str, float] = case.truth["nominal_parameters_true"]  # type: ignore[assignment]
        known: ContactLaw = study["nominal_law"]  # type: ignore[assignment]
        told = {str(entry["parameter"]): true_value(entry, self.values) for entry in self.entries}
        self.law: ContactLaw = replace(known, **told)  # type: ignore[arg-type]
        time: Array = study["time"]  # type: ignore[assignment]
        states: Array = study["states"]  # type: ignore[assignment]
        self.noise: tuple[ChannelNoise, ChannelNoise] = (study["position"], study["rotation"])  # type: ignore[assignment]
        self.coarse = float(np.mean(np.diff(time)))
        self.step = self.coarse / _PARTS
        last = float(time[:, -1].min())
        self.time = np.tile(np.arange(0.0, last, self.step), (len(time), 1))
        channels = Channels(time, _pose_curves(time, true, states))
        for item in self.effects:
            channels = item.sensor(channels) if item.sensor else channels
        pose = np.stack([channels.columns[f"pose.{self.link.name}.{axis}"](self.time) for axis in POSE], axis=2)
        self.p = pose[:, :, :3]
        q = pose[:, :, 3:] / np.linalg.norm(pose[:, :, 3:], axis=2, keepdims=True)
        self.rotation = Rotation.from_quat(q[:, :, [1, 2, 3, 0]].reshape(-1, 4)).as_matrix().reshape(*q.shape[:2], 3, 3)
        self.v = np.gradient(self.p, self.step, axis=1)
        rate = np.gradient(self.rotation, self.step, axis=1) @ self.rotation.swapaxes(2, 3)
        self.omega = 0.5 * np.stack(
            [rate[..., 2, 1] - rate[..., 1, 2], rate[..., 0, 2] - rate[..., 2, 0], rate[..., 1, 0] - rate[..., 0, 1]],
            axis=2,
        )
        self.frame = Toss(self.link, true.shape, self.law, np.array([0.0, 0.0, -9.81]))
        self.windows = Windows.over(self.p.shape[1], self.step, _WINDOW)
        self.nominal = self.effort(self.frame)
        self.std = self._noise()
        self._looks: list[Alternative] | None = None

    def effort(self, toss: Toss) -> Array:
        """Force and torque about the body's origin (B, N, 6), weight and contact, by memoryless laws."""
        count = self.p.shape[0] * self.p.shape[1]
        p, v, omega = (x.reshape(count, 3) for x in (self.p, self.v, self.omega))
        rotation = self.rotation.reshape(count, 3, 3)
        pushed, torque = self._contact(toss, p, v, omega, rotation)
        total = pushed + toss.link.mass * toss.gravity - toss.drag * np.linalg.norm(v, axis=1, keepdims=True) * v
        lever = rotation @ toss.link.com
        torque += np.cross(lever, toss.link.mass * toss.gravity)
        return np.concatenate([total, torque], axis=1).reshape(*self.p.shape[:2], 6)

    def _contact(self, toss: Toss, p: Array, v: Array, omega: Array, rotation: Array) -> tuple[Array, Array]:
        """Force and torque (N, 3) about the body's origin where the ground is near enough to be felt."""
        points, t = toss.contact_points(p, rotation), self.time.ravel()
        felt = 40.0 * toss.law.adhesion_range if toss.law.adhesion else 0.0  # beyond which 1e-17 is left
        near = np.flatnonzero((toss.law.depth(t, points) > -felt).any(axis=1))
        points, t = points[near], t[near]
        arms = points - p[near, None, :]
        speeds = v[near, None, :] + np.cross(omega[near, None, :], arms)
        hidden = np.zeros((*points.shape[:2], ContactLaw.hidden))
        force, pushing, _, _ = toss.law.force(t, points, speeds, hidden, toss.law.depth(t, points) > 0.0)
        total, torque = np.zeros_like(p), np.zeros_like(p)
        total[near], torque[near] = force.sum(axis=1), np.cross(arms, force).sum(axis=1)
        if toss.law.rolling:
            torque[near] -= toss._rolling(omega[near], pushing.sum(axis=1))
        return total, torque

    def momentum(self, link: Link) -> Array:
        """Momentum and spin about the body's origin (B, N, 6)."""
        spin = np.einsum("bnij,jk,bnlk,bnl->bni", self.rotation, link.inertia, self.rotation, self.omega)
        lever = np.einsum("bnij,j->bni", self.rotation, link.com)
        linear = link.mass * (self.v + np.cross(self.omega, lever))
        return np.concatenate([linear, spin + np.cross(lever, linear)], axis=2)

    def _noise(self) -> Array:
        """Std (B, W, 6): twice differentiated pose noise, and contact stiffness, damping and slip times it."""
        coarse = Windows.over(int(self.p.shape[1] / _PARTS), self.coarse, _WINDOW)
        w, w1, w2 = coarse.shape
        position, rotation = self.noise
        touching = (np.abs(self.nominal[:, :, 2] + 9.81 * self.link.mass) > 1e-9).astype(float)
        share = self.windows.integrate(touching, self.windows.shape[0]) / (self.step * self.windows.shape[0].sum())
        reach = self.frame.shape.radius or 0.5 * float(np.linalg.norm(self.frame.shape.extents))
        points = 1.0 if self.frame.shape.radius else 2.0
        at_contact = [np.hypot(coarse.noise_std(x, position), reach * coarse.noise_std(x, rotation)) for x in (w, w1)]
        push = points * np.hypot(self.law.stiffness * at_contact[0], self.law.damping * at_contact[1])
        inertia = float(np.trace(self.link.inertia)) / 3.0
        linear = (self.link.mass * coarse.noise_std(w2, position)) ** 2 + share * push**2
        turning = (inertia * coarse.noise_std(w2, rotation)) ** 2 + share * (push * reach) ** 2
        return np.sqrt(np.stack([linear] * 3 + [turning] * 3, axis=2))

    def whiten(self, effort: Array, momentum: Array | None = None) -> Array:
        w, w1, _ = self.windows.shape
        rows = -self.windows.integrate(effort, w)
        if momentum is not None:
            rows = rows - self.windows.integrate(momentum, w1)
        return rows / self.std

    def excess(self) -> Excess:
        unknown = []
        for entry in self.entries:
            name = str(entry["parameter"])
            law = replace(self.law, **{name: float(getattr(self.law, name)) + 0.1 * float(entry["std"])})  # type: ignore[arg-type]
            unknown.append(10.0 * self.whiten(self.effort(replace(self.frame, law=law)) - self.nominal))
        rows = self.whiten(self.nominal, self.momentum(self.link))
        return Excess(CHANNELS, rows, np.stack(unknown), self._centres(), offsets(self.entries, self.values))

    def _centres(self) -> Array:
        return self.time[:, self.windows.centres()]

    def shown_in(self, item: Concealed) -> None:
        """An effect may be seen in every channel."""

    def alternatives(self, item: Concealed, excess: Excess) -> list[Alternative]:
        """They are the same for every effect and excess."""
        if self._looks is None:
            self._looks = [Alternative(name, at, np.stack(spans), count) for name, at, count, spans in self._named()]
        return self._looks

    def _named(self) -> Iterator[tuple[str, str, int, list[Array]]]:
        """Name, place, number of parameters and rows that span it."""
        pair, body, law = f"{self.link.name}/ground", self.link.name, self.law

        def seen(**changes: object) -> Array:
            return self.whiten(self.effort(replace(self.frame, law=replace(law, **changes))) - self.nominal)  # type: ignore[arg-type]

        yield "surface_offset", "ground", 1, [seen(offset=1e-5)]
        yield "surface_tilt", "ground", 2, [seen(tilt=(1e-4, 0.0)), seen(tilt=(0.0, 1e-4))]
        yield "contact_nonlinear_stiffness", pair, 1, [seen(cubic=0.01 * law.stiffness / 1e-6)]
        yield "contact_hunt_crossley_dissipation", pair, 1, [seen(dissipation=0.01)]
        for reach in (3e-4, 1e-3, 3e-3):
            yield "contact_adhesion", pair, 2, [seen(adhesion=0.01, adhesion_range=reach)]
        for speed in (0.05, 0.15, 0.4):
            yield "contact_stribeck_friction", pair, 2, [seen(static=law.friction * 1.01, stribeck_velocity=speed)]
        mu = law.friction
        yield (
            "contact_anisotropic_friction",
            pair,
            3,
            [seen(anisotropic=(1.01 * mu, 0.99 * mu, x)) for x in (0.0, 0.25 * np.pi)],
        )
        if self.frame.shape.radius:
            yield "contact_rolling_resistance", pair, 1, [seen(rolling=1e-4)]
        yield "aerodynamic_drag", body, 1, [self.whiten(self.effort(replace(self.frame, drag=1e-3)) - self.nominal)]
        tilts = [Rotation.from_euler(axis, 1e-3).as_matrix() @ self.frame.gravity for axis in "xy"]
        yield (
            "gravity_misalignment",
            "world",
            2,
            [self.whiten(self.effort(replace(self.frame, gravity=g)) - self.nominal) for g in tilts],
        )
        loads = []
        for p in (np.zeros(3), *(0.01 * np.eye(3))):
            link = self.link.with_point_mass(0.01 * self.link.mass, p)
            effort = self.effort(replace(self.frame, link=link)) - self.nominal
            loads.append(self.whiten(effort, self.momentum(link) - self.momentum(self.link)))
        yield "payload", body, 4, loads
