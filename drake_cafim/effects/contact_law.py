"""Another law of the normal force than the scenario's."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.contact.law import ContactLaw
from drake_cafim.contact.normal import NORMAL_LAWS
from drake_cafim.contact.pressure import field_numbers
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import ContactEffect, ContactLook
from drake_cafim.effects.effect import Direction, Effect, Strength
from drake_cafim.effects.surroundings import Surroundings

LAWS: Mapping[str, float] = {"hydroelastic": float(NORMAL_LAWS.index("hydroelastic"))}
"""The laws that replace the scenario's. Hunt and Crossley's is a spring with their dissipation, which has its name."""
SLIP_VELOCITY = 0.001
"""m/s, width of the friction that comes with Drake's pressure field, in place of the paper's resistance.

MultibodyPlant's default stiction tolerance; its discrete solvers slip less.
"""
DEPTHS = (0.5, 0.8, 1.0)
"""Quantiles of the depth at which a look has the spring's force."""


@dataclass(frozen=True)
class ContactLawChange(ContactEffect):
    """λ = P h² (1 − k h) max(0, 1 + c ḋ) in place of the scenario's law: Drake's pressure field of a sphere."""

    name: ClassVar[str] = "contact_law"
    decides_bounces: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("modulus", "Pa", 1e7, lower=1.0),
        Strength("dissipation", "s/m", 1.0, lower=0.0, amplitude=False),
    )
    shapes: ClassVar[tuple[Strength, ...]] = (
        Strength(
            "law",
            "",
            LAWS["hydroelastic"],
            nominal=LAWS["hydroelastic"],
            choices=tuple(LAWS.values()),
            names=tuple(LAWS),
        ),
    )
    difference_step: ClassVar[float] = 1e-5
    reference: ClassVar[str] = "Elandt, Drumwright, Sherman, Ruina, A pressure field model, 2019"
    formula: ClassVar[str] = "<i>P</i> <i>h</i>² (1 − <i>k</i> <i>h</i>) max(0, 1 + <i>c</i> δ̇) in place of the law"
    words: ClassVar[str] = "is not the scenario's: the force grows with the square of the depth"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_nonlinear_stiffness": "both stiffen the contact as it is pressed in",
        "contact_hunt_crossley_dissipation": "both damp the contact more the deeper it is pressed",
        "surface_offset": "a force that begins slowly is like a lower surface, pressed about one depth",
    }

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        """Contacts of a robot's sphere whose law is another one; where boxes are thrown the law has no force."""
        if where.thrown is None:
            spheres = [contact for contact in where.contacts if contact.parameters.radius]
            yield from dict.fromkeys(cls.site(contact) for contact in spheres if contact.law.normal not in LAWS)

    def on(self, contact: SphereContact) -> SphereContact:
        """The contact with the law and its parameters replaced; Drake's law has friction without a resistance."""
        own: dict[str, Any] = {name: self.values[name] for name in ("modulus", "dissipation")}
        if contact.parameters.resistance is not None:
            own |= {"resistance": None, "slip_velocity": SLIP_VELOCITY}
        law = ContactLaw("hydroelastic", contact.law.smoothing)
        return replace(contact, law=law, parameters=replace(contact.parameters, **own))

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        """The law in place of the scenario's, at the modulus with the same force at a depth; and its dissipation.

        With a spring K that is fitted as well, the coefficient a of the first column is P over that of the look, and
        the coefficient of the second a c.
        """
        depths = touch.penetration[touch.penetration > 0.0]
        given = contact.parameters
        if not len(depths) or not given.stiffness:
            return
        per_modulus, narrowing, deficit = field_numbers(1.0, given.radius, given.half_extent, given.resolution)
        for depth in np.quantile(depths, DEPTHS).tolist():
            h = float(depth - deficit)
            if not 0.0 < h * float(narrowing) < 2.0 / 3.0:
                continue
            modulus = float(given.stiffness * depth / (per_modulus * h**2 * (1.0 - narrowing * h)))
            still, moving = {"modulus": modulus, "dissipation": 0.0}, {"modulus": modulus, "dissipation": 1.0}
            steps = (Direction(still, None, 1.0), Direction(moving, still, 1.0))
            yield ContactLook(steps, lambda c, modulus=modulus: self._scaled(modulus, c))  # type: ignore[misc]

    def _scaled(self, modulus: float, coefficients: tuple[float, float]) -> Effect | None:
        share, loss = (float(value) for value in coefficients)
        if not share > 0.0:
            return None
        return self.with_values({"modulus": modulus * share, "dissipation": max(loss / share, 0.0)})
