"""The model elements that effects can attach to, and the arguments of an effect's custom Drake system."""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.servo import Servo


@dataclass(frozen=True)
class Surroundings:
    """A robot's or a thrown body's `tree`, its `contacts`, and the recordings' `columns` that have noise."""

    tree: Tree
    contacts: Sequence[SphereContact] = ()
    columns: Sequence[str] = ()
    thrown: str | None = None
    """The body that is thrown; None for a robot."""
    inertials: Sequence[str] = ()
    """The links whose inertials are unknown, with a prior."""
    servos: Sequence[Servo] = ()
    """The position servos that drive joints in the recordings."""


@dataclass(frozen=True)
class SystemPlace:
    """Arguments of an effect's Drake system: the joints of `tree`, or the channels `columns` that pass through it.

    Its discrete state is updated every `period` s.
    """

    tree: Tree
    period: float
    columns: Sequence[str] = ()
