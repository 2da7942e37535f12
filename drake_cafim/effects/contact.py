"""What contacts do beyond their nominal law, as effects: where they are looked for, and how a search starts."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.contact.change import ContactChange, Touch
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.effect import Direction, Effect, Place
from drake_cafim.typing import Array

FRICTION = "contact friction"


@dataclass(frozen=True)
class ContactLook:
    """Steps along which the effect is all but linear, and the effect that coefficients of them stand for."""

    steps: tuple[Direction, ...]
    build: Callable[[Array], Effect | None]


@dataclass(frozen=True)
class ContactEffect(Effect, ContactChange):
    """A change of the law of one contact; `at` names its two bodies, in either order."""

    place: ClassVar[Place] = Place.CONTACT
    family: ClassVar[str] = "contact"

    def meets(self, contact: SphereContact) -> bool:
        """Whether this is the contact that is meant."""
        return set(self.at.split("/")) == set(contact.bodies)

    def on(self, contact: SphereContact) -> SphereContact:
        """The contact with the effect in it."""
        return contact.changed(self)

    @classmethod
    def site(cls, contact: SphereContact) -> str:
        """What `at` is for this contact."""
        return contact.name

    @abstractmethod
    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        """Linear looks at the effect in a contact whose touches, of all recordings, are `touch`."""

    def single(self, strength: str, size: float, shape: Mapping[str, float]) -> ContactLook:
        """A look along one strength with the others held at `shape`."""
        step = Direction({**shape, strength: size}, None, size)
        return ContactLook((step,), lambda c: self.with_values({**shape, strength: float(c[0])}))


def pressing(touch: Touch) -> Array:
    """Where the two bodies touch, (N,)."""
    return np.asarray(touch.penetration > 0.0)
