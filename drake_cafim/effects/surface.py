"""Effects on a surface's pose: its plane is raised or tilted relative to the model."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from drake_cafim.contact.change import Touch, surface_axes
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import ContactLook, on_contacts
from drake_cafim.effects.effect import Effect, P, Place, Strength
from drake_cafim.effects.surroundings import Surroundings


@dataclass(frozen=True)
class SurfaceEffect(Effect):
    """Another plane for every contact with one surface; `at` is the surface's body."""

    place: ClassVar[Place] = Place.BODY
    family: ClassVar[str] = "contact"
    kind: ClassVar[str] = "surface"
    of_contact: ClassVar[bool] = True
    decides_bounces: ClassVar[bool] = True
    """Whether it determines where and how high a thrown body bounces."""
    surprise: ClassVar[float] = -2.0 * float(np.log(10.0))
    """Prior odds 10 : 1 in favour: surfaces are placed by hand, to a millimetre or a degree, links are not."""

    needs_plane: ClassVar[bool] = False
    """Whether it can change a plane only, not a box that is touched all round."""

    def add_to(self, physics: P) -> P:
        return on_contacts(self, physics)

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        able = [contact for contact in where.contacts if contact.flat or not cls.needs_plane]
        yield from dict.fromkeys(cls.site(contact) for contact in able)

    def meets(self, contact: SphereContact) -> bool:
        """Whether `at` is the surface body of this contact."""
        return contact.bodies[1] == self.at and (contact.flat or not self.needs_plane)

    @classmethod
    def site(cls, contact: SphereContact) -> str:
        """The value of `at` for this contact's surface: the name of its second body."""
        return contact.bodies[1]

    @abstractmethod
    def on(self, contact: SphereContact) -> SphereContact:
        """The contact with its plane moved."""

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        """One linearization, by central steps of the strengths."""
        yield ContactLook(self.directions(), self.from_directions)

    @abstractmethod
    def grid(self) -> Iterator[Mapping[str, float]]:
        """Start values far apart: how often the bodies touch is strongly nonlinear in the surface's position."""


@dataclass(frozen=True)
class SurfaceOffset(SurfaceEffect):
    """The plane shifted by `offset` m along its normal."""

    name: ClassVar[str] = "surface_offset"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("offset", "m", 1e-4, lower=-0.2, upper=0.2),)
    difference_step: ClassVar[float] = 0.1
    reference: ClassVar[str] = "De Schutter and others, Int. J. Robotics Research 18(12), 1999 (geometry from contact)"
    formula: ClassVar[str] = "raised by the offset along its normal"
    words: ClassVar[str] = "puts the surface elsewhere than the model has it"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_adhesion": "during lasting contact a lower surface and a constant pull press alike",
        "contact_nonlinear_stiffness": "pressed about one depth, a stiffer spring and a higher surface push alike",
        "sensor_bias": "a position or force that is off by a constant looks like another height",
        "surface_tilt": "where the motion stays on one side of the origin, a slope is a height",
    }

    def grid(self) -> Iterator[Mapping[str, float]]:
        for size in (0.0, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
            yield {"offset": size}
            yield {"offset": -size}

    def on(self, contact: SphereContact) -> SphereContact:
        return contact.raised(self.values["offset"])


@dataclass(frozen=True)
class SurfaceTilt(SurfaceEffect):
    """The plane turned about its nominal origin: normal ~ (−tan sx, −tan sy, 1) in the surface's axes."""

    name: ClassVar[str] = "surface_tilt"
    needs_plane: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("y_slope_x", "rad", 0.01, lower=-1.4, upper=1.4),
        Strength("y_slope_y", "rad", 0.01, lower=-1.4, upper=1.4),
    )
    difference_step: ClassVar[float] = 0.1
    reference: ClassVar[str] = "Karayiannidis, Doulgeri, Automatica 45(10), 2009 (unknown slope of a surface)"
    formula: ClassVar[str] = "normal ∝ (−tan <i>s</i><sub>x</sub>, −tan <i>s</i><sub>y</sub>, 1)"
    words: ClassVar[str] = "tilts the surface"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_misalignment": "a turned sensor sees the push from where a turned surface would send it",
        "surface_offset": "where the motion stays on one side of the origin, a slope is a height",
        "contact_anisotropic_friction": "both put force across the sliding; a slope does so at rest too",
    }

    def grid(self) -> Iterator[Mapping[str, float]]:
        yield {"y_slope_x": 0.0, "y_slope_y": 0.0}
        for size in (0.02, 0.1):
            for angle in np.arange(8) * 0.25 * np.pi:
                yield {"y_slope_x": size * float(np.cos(angle)), "y_slope_y": size * float(np.sin(angle))}

    def on(self, contact: SphereContact) -> SphereContact:
        normal = surface_axes(contact.normal) @ np.array(
            [-np.tan(self.values["y_slope_x"]), -np.tan(self.values["y_slope_y"]), 1.0]
        )
        return replace(contact, normal=np.asarray(normal / np.linalg.norm(normal)))
