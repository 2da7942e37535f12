"""Dispatch on the kind of an effect (joint force, actuator, sensor, ...)."""

from abc import ABC
from collections.abc import Sequence
from typing import Generic, TypeVar

from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.body import BodyForce, ExternalDisturbance
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.coupling import JointCoupling
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.link import Payload, TreeEffect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.errors import InputError

T = TypeVar("T")
KINDS: tuple[type[Effect], ...] = (
    JointForce,
    ActuatorEffect,
    JointCoupling,
    BodyForce,
    TreeEffect,
    ContactEffect,
    SurfaceEffect,
    SensorEffect,
    ServoEffect,
)
"""The base classes that a user-defined effect may derive from."""


def expected_kinds() -> str:
    """The names of `KINDS`, separated by commas, for error messages."""
    return ", ".join(kind.__name__ for kind in KINDS)


class ByKind(ABC, Generic[T]):
    """A function of an effect with one method per kind; the effect's `kind` names the method that is called.

    A kind without an overridden method falls back to that of its more general kind, and finally to `other`.
    """

    def __call__(self, effect: Effect) -> T:
        """The value for `effect`; `TypeError` where its kind is unknown."""
        method = getattr(self, effect.kind, None) if effect.kind else None
        if method is None:
            raise TypeError(f"effect {effect.name}: of no known kind; expected a subclass of {expected_kinds()}")
        value: T = method(effect)
        return value

    def other(self, effect: Effect) -> T:
        """The value for every kind without a method; by default it raises `TypeError`."""
        raise TypeError(f"effect {effect.name}: {type(self).__name__} does not handle the kind {effect.kind}")

    def joint_force(self, effect: JointForce) -> T:
        return self.other(effect)

    def actuator(self, effect: ActuatorEffect) -> T:
        return self.other(effect)

    def coupling(self, effect: JointCoupling) -> T:
        return self.other(effect)

    def body_force(self, effect: BodyForce) -> T:
        return self.other(effect)

    def push(self, effect: ExternalDisturbance) -> T:
        return self.body_force(effect)

    def obstacle(self, effect: UnmodeledContact) -> T:
        return self.body_force(effect)

    def tree(self, effect: TreeEffect) -> T:
        return self.other(effect)

    def load(self, effect: Payload) -> T:
        return self.tree(effect)

    def contact(self, effect: ContactEffect) -> T:
        return self.other(effect)

    def surface(self, effect: SurfaceEffect) -> T:
        return self.other(effect)

    def sensor(self, effect: SensorEffect) -> T:
        return self.other(effect)

    def servo(self, effect: ServoEffect) -> T:
        return self.other(effect)


def check_kinds(effects: Sequence[type[Effect]]) -> None:
    """Raises `InputError` for an effect class whose `kind` is none of the known ones."""
    for effect in effects:
        if not getattr(effect, "kind", "") or not hasattr(ByKind, effect.kind):
            name = getattr(effect, "__name__", effect)
            raise InputError(f"effect class {name}: it is of no known kind, expected a subclass of {expected_kinds()}")
