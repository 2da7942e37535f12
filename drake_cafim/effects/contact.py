"""Effects that change a contact's law: their places, their linearizations for screening, and their base class."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from drake_cafim.contact.change import ContactChange, Touch
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.effect import Direction, Effect, P, Place
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

FRICTION = "contact friction"


class OnContacts(Protocol):
    """An effect that changes contacts."""

    @property
    def key(self) -> tuple[str, str]: ...
    def meets(self, contact: SphereContact) -> bool: ...
    def on(self, contact: SphereContact) -> SphereContact: ...


def on_contacts(effect: OnContacts, physics: P) -> P:
    """A copy of `physics` with the effect applied to its contacts; `InputError` where no contact is at its place."""
    if not any(effect.meets(contact) for contact in physics.contacts):
        known = ", ".join(contact.name for contact in physics.contacts) or "none"
        name, at = effect.key
        raise InputError(f"effect {name} at {at}: no contact is there; the scenario has: {known}")
    contacts = tuple(effect.on(contact) if effect.meets(contact) else contact for contact in physics.contacts)
    return physics.changed(contacts=contacts)


@dataclass(frozen=True)
class ContactLook:
    """Steps along which the effect is nearly linear, and `build`, from their coefficients to the effect."""

    steps: tuple[Direction, ...]
    build: Callable[[Array], Effect | None]


@dataclass(frozen=True)
class ContactEffect(Effect, ContactChange):
    """A change of the law of one contact; `at` names its two bodies, in either order."""

    place: ClassVar[Place] = Place.CONTACT
    family: ClassVar[str] = "contact"
    kind: ClassVar[str] = "contact"
    of_contact: ClassVar[bool] = True
    decides_bounces: ClassVar[bool] = False
    """Whether it determines where and how high a thrown body bounces."""
    needs_plane: ClassVar[bool] = False
    """Whether it is of the sliding on a plane, not on a box that is touched all round."""

    def add_to(self, physics: P) -> P:
        return on_contacts(self, physics)

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        able = [contact for contact in where.contacts if contact.flat or not cls.needs_plane]
        yield from dict.fromkeys(cls.site(contact) for contact in able)

    def meets(self, contact: SphereContact) -> bool:
        """Whether `at` names this contact's two bodies, and the effect can act there."""
        return set(self.at.split("/")) == set(contact.bodies) and (contact.flat or not self.needs_plane)

    def on(self, contact: SphereContact) -> SphereContact:
        """The contact with the effect added to its changes."""
        return contact.changed(self)

    @classmethod
    def site(cls, contact: SphereContact) -> str:
        """The value of `at` for this contact."""
        return contact.name

    @abstractmethod
    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        """Linearizations of the effect for screening; `touch` is the contact's kinematics in all recordings."""

    def single(self, strength: str, size: float, shape: Mapping[str, float]) -> ContactLook:
        """The linearization in one strength, a step of `size`, with the other parameters held at `shape`."""
        step = Direction({**shape, strength: size}, None, size)
        return ContactLook((step,), lambda c: self.with_values({**shape, strength: float(c[0])}))


def pressing(touch: Touch) -> Array:
    """(N,) booleans: whether the two bodies touch, penetration > 0."""
    return np.asarray(touch.penetration > 0.0)
