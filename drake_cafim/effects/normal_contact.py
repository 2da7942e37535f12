"""Normal contact force beyond a spring and a damper: cubic stiffness, Hunt–Crossley, adhesion, relaxation."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.contact.change import Touch, recursion
from drake_cafim.contact.law import ContactParameters
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import ContactEffect, ContactLook, pressing
from drake_cafim.effects.effect import Strength
from drake_cafim.typing import Array

ADHESION_CUTOFF = 12.0
"""Cut-off of adhesion in multiples of its range: exp(−12) ≈ 6·10⁻⁶ of the force is neglected."""


@dataclass(frozen=True)
class ContactNonlinearStiffness(ContactEffect):
    """+ cubic·d³."""

    name: ClassVar[str] = "contact_nonlinear_stiffness"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("cubic", "N/m^3", 1e9, lower=0.0),)
    reference: ClassVar[str] = "Johnson, Contact Mechanics, 1985, ch. 4 (stiffness that grows with the contact area)"
    formula: ClassVar[str] = "+ <i>c</i> δ³"
    words: ClassVar[str] = "stiffens the contact as it is pressed in"
    alike: ClassVar[Mapping[str, str]] = {
        "surface_offset": "pressed about one depth, a stiffer spring and a higher surface push alike",
        "contact_hunt_crossley_dissipation": "both show only where the bodies are pressed deep",
        "contact_viscoelastic_relaxation": "both stiffen the contact under quick presses",
    }

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array:
        return np.asarray(self.values["cubic"] * np.maximum(touch.penetration, 0.0) ** 3)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        yield self.single("cubic", 1e7, {})


@dataclass(frozen=True)
class ContactHuntCrossleyDissipation(ContactEffect):
    """+ K d c ḋ."""

    name: ClassVar[str] = "contact_hunt_crossley_dissipation"
    decides_bounces: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("dissipation", "s/m", 1.0, lower=0.0),)
    reference: ClassVar[str] = "Hunt, Crossley, J. Applied Mechanics 42(2), 1975"
    formula: ClassVar[str] = "+ <i>K</i> δ <i>c</i> δ̇"
    words: ClassVar[str] = "damps the contact, more the deeper it is pressed"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_viscoelastic_relaxation": "a force that dies away fast damps as well",
        "contact_nonlinear_stiffness": "both show only where the bodies are pressed deep",
        "sensor_lag": "damping that grows with depth brings the force forward, a lag takes it back",
        "sensor_delay": "damping that grows with depth brings the force forward, a delay takes it back",
    }

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array:
        depth = np.maximum(touch.penetration, 0.0)
        return np.asarray(parameters.stiffness * depth * self.values["dissipation"] * touch.rate)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        yield self.single("dissipation", 0.1, {})


@dataclass(frozen=True)
class ContactAdhesion(ContactEffect):
    """A pull of `force`, times exp(d/range) outside of contact (d < 0); it does not enter the friction."""

    name: ClassVar[str] = "contact_adhesion"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("force", "N", 1.0, lower=0.0),
        Strength("range", "m", 1e-3, lower=1e-5, upper=0.1, amplitude=False),
    )
    difference_step: ClassVar[float] = 1e-3
    reference: ClassVar[str] = "Maugis, Contact, Adhesion and Rupture of Elastic Solids, 2000, ch. 4"
    formula: ClassVar[str] = "−<i>F</i>, times exp(δ/range) outside"
    words: ClassVar[str] = "pulls the two bodies together"
    alike: ClassVar[Mapping[str, str]] = {
        "surface_offset": "during lasting contact a constant pull and a lower surface press alike; friction tells them",
        "sensor_bias": "a constant pull during lasting contact is an offset of the force; the axes tell them apart",
        "actuator_bias": "during lasting contact a constant pull acts on the axis as an effort does",
    }

    @property
    def reach(self) -> float:
        return ADHESION_CUTOFF * self.values["range"]

    def pull(self, touch: Touch) -> Array:
        decay = np.exp(np.minimum(touch.penetration, 0.0) / self.values["range"])
        return np.asarray(-self.values["force"] * decay)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        for reach in (1e-4, 3e-4, 1e-3, 3e-3):
            yield self.single("force", 0.1, {"range": reach})


@dataclass(frozen=True)
class ContactViscoelasticRelaxation(ContactEffect):
    """+ s, ṡ = stiffness·ḋ − s/τ in contact.

    Its memory is the relaxed depth y: s = stiffness (d − y) with τ ẏ = d − y, y = 0 at touch-down. y is smooth, so
    that a sample's noise enters through d alone.
    """

    name: ClassVar[str] = "contact_viscoelastic_relaxation"
    memory: ClassVar[int] = 1
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("stiffness", "N/m", 1000.0, lower=0.0),
        Strength("time_constant", "s", 0.1, lower=5e-4, upper=20.0, amplitude=False),
    )
    difference_step: ClassVar[float] = 1e-3
    reference: ClassVar[str] = "Johnson, Contact Mechanics, 1985, §6.5 (Maxwell element beside a spring)"
    formula: ClassVar[str] = "+ <i>s</i>, <i>ṡ</i> = <i>k</i> δ̇ − <i>s</i>/τ"
    words: ClassVar[str] = "adds a force on pressing in that dies away"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_hunt_crossley_dissipation": "a force that dies away fast damps as well",
        "contact_nonlinear_stiffness": "both stiffen the contact under quick presses",
        "surface_offset": "what has not relaxed within the recording is an offset",
        "sensor_drift": "one slow relaxation over a recording is a drift",
    }

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        tau, d = self.values["time_constant"], touch.penetration
        steps = np.diff(time, prepend=time[0])
        before = np.concatenate([d[:1], d[:-1]])
        slope = np.where(steps > 0.0, (d - before) / np.where(steps > 0.0, steps, 1.0), 0.0)
        # within a step the depth is linear; a step that begins outside of contact starts at touch-down, with y = 0
        outside = before <= 0.0
        steps = np.where(outside & (slope > 0.0), np.maximum(d, 0.0) / np.where(slope > 0.0, slope, 1.0), steps)
        start = np.where(outside, 0.0, before)
        kept = np.exp(-steps / tau)
        inside = pressing(touch)
        added = np.where(inside, d - tau * slope - kept * (start - tau * slope), 0.0)
        return recursion(np.where(np.logical_and(inside, before > 0.0), kept, 0.0), added[:, None])

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        y, d = memory[:, 0], touch.penetration
        moved = y + (d - y) * -np.expm1(-elapsed / self.values["time_constant"])
        return np.where(pressing(touch), moved, 0.0)[:, None]

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array:
        return np.asarray(self.values["stiffness"] * np.where(pressing(touch), touch.penetration - memory[:, 0], 0.0))

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        for tau in (0.004, 0.01, 0.025, 0.06, 0.15, 0.4, 1.0):
            yield self.single("stiffness", 10.0, {"time_constant": tau})
