"""What an effect is: a named piece of physics at a place, with its strengths."""

from abc import ABC
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import ClassVar, Self

import numpy as np

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.mean_sign import MeanSign
from drake_cafim.errors import InputError
from drake_cafim.rounding import short
from drake_cafim.typing import Array


class Place(Enum):
    """What an effect attaches to."""

    JOINT = "joint"
    ACTUATOR = "actuator"
    BODY = "body"
    WORLD = "environment"
    CONTACT = "contact"
    CHANNEL = "sensor"


CHANNEL_UNIT = "unit of the channel"
SIGNS = 12
"""Widths of sign changes whose means a joint's samples keep."""


def channel_unit(column: str, tree: Tree) -> str:
    """The SI unit of a recording's column, or what stands for it where a whole sensor is meant."""
    kind, _, rest = column.partition(".")
    if kind in ("q", "v", "u", "cmd") and rest in tree.joint_names:
        joint = tree.joints[tree.joint_index(rest)]
        units = {"q": joint.position_unit, "cmd": joint.position_unit, "v": f"{joint.position_unit}/s"}
        return units.get(kind, joint.effort_unit)
    last = column.rsplit(".", 1)[-1]
    if kind == "wrench" and last in ("fx", "fy", "fz"):
        return "N"
    if kind == "wrench" and last in ("tx", "ty", "tz"):
        return "N m"
    return "m" if kind == "pose" and last in ("x", "y", "z") else CHANNEL_UNIT


@dataclass(frozen=True)
class Strength:
    """One parameter of an effect.

    `typical` is the size at which engineers meet it, the scale of the weak prior that evidence needs; `unit` is for
    a revolute joint, and `linear_unit` for a prismatic one.
    """

    name: str
    unit: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    nominal: float = 0.0
    """The value at which the effect is absent."""
    inverse: bool = False
    """Whether the effect is absent at infinity instead. Its inverse then vanishes, and is as many of its own standard
    deviations from zero as the number itself, so that a test against zero serves both."""
    linear_unit: str | None = None
    grid: tuple[float, ...] = ()
    """Of a shape: the values that it may take."""
    amplitude: bool = True
    """Whether the effect is absent at the nominal value; otherwise the number only says what it looks like."""
    through: str = ""
    """Of a number that acts through another strength, such as where a mass is: their product is what vanishes."""


@dataclass(frozen=True)
class JointSamples:
    """One joint's motion and effort, each (N,): rad or m, rad/s or m/s, N m or N."""

    q: Array
    v: Array
    u: Array
    v_std: Array | float = 0.0
    """What is not known of v; a force that bends sharply in v is averaged over it."""
    q_reach: Array | float = 0.0
    """How far q gets within half the time that a sample stands for; a force that sets in on the way is averaged."""
    _signs: dict[float, MeanSign] = field(default_factory=dict, init=False, repr=False, compare=False)

    def sign(self, width: float) -> MeanSign:
        """The mean sign of v that changes over `width`; the last few are kept."""
        if width not in self._signs:
            while len(self._signs) >= SIGNS:
                self._signs.pop(next(iter(self._signs)))
            self._signs[width] = MeanSign.of(self.v, self.v_std, width)
        return self._signs[width]

    def moved(self, by: Array) -> "JointSamples":
        """The samples with other velocities."""
        return replace(self, v=self.v + by)


def joined(samples: Sequence[JointSamples]) -> JointSamples:
    """The samples of several recordings, one after the other."""
    names = ("q", "v", "u", "v_std", "q_reach")
    return JointSamples(
        *(np.concatenate([np.broadcast_to(getattr(one, name), one.q.shape) for one in samples]) for name in names)
    )


@dataclass(frozen=True)
class Force:
    """A generalized force and its derivatives: `value`, `d_q`, `d_v`, `d_u` (N,), `d_strengths` (N, k)."""

    value: Array
    d_q: Array
    d_v: Array
    d_u: Array
    d_strengths: Array


@dataclass(frozen=True)
class Start:
    """A linear look at an effect: `columns` (N, c) of force whose coefficients an exact fit can start from.

    `shape` holds the strengths that the columns were made with and that no coefficient gives.
    """

    columns: Array
    shape: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Direction:
    """A finite step of an effect's strengths, from `behind` to `ahead`, worth `size` of one coefficient.

    `behind` None is the model without the effect.
    """

    ahead: Mapping[str, float]
    behind: Mapping[str, float] | None
    size: float


@dataclass(frozen=True)
class Effect(ABC):
    """A piece of physics `at` a place with its `values`; without values it is a hypothesis.

    Subclasses say everything once as class attributes, and override the hook through which their physics acts.
    """

    at: str
    values: Mapping[str, float] = field(default_factory=dict)

    name: ClassVar[str]
    family: ClassVar[str]
    place: ClassVar[Place]
    strengths: ClassVar[tuple[Strength, ...]]
    shapes: ClassVar[tuple[Strength, ...]] = ()
    """Numbers of the law that are not strengths, such as the width of a sign change, fitted from a grid where they have
    one."""
    difference_step: ClassVar[float] = 1e-4
    """Step of finite differences by strengths, as a share of the typical size."""
    group: ClassVar[str | None] = None
    """Effects of one group are laws of the same thing: at one place at most one of them holds."""
    surprise: ClassVar[float] = 0.0
    """−2 ln of its odds before any recording, against those of the other effects."""
    reference: ClassVar[str]
    alike: ClassVar[Mapping[str, str]] = {}
    """Names of effects that look like this one, and why."""

    def __post_init__(self) -> None:
        known = [strength.name for strength in (*self.strengths, *self.shapes)]
        wrong = sorted(set(self.values) - set(known))
        if wrong:
            valid = ", ".join(known)
            raise InputError(f"effect {self.name} at {self.at}: unknown parameter {', '.join(wrong)}; valid: {valid}")

    @property
    def key(self) -> tuple[str, str]:
        return (self.name, self.at)

    def excludes(self, other: "Effect") -> bool:
        """Whether the two cannot both be there."""
        same_group = self.group is not None and self.group == other.group
        return self.at == other.at and (self.name == other.name or same_group)

    def with_values(self, values: Mapping[str, float] | Array) -> Self:
        """The effect with these strengths, a mapping or a vector in the order of `strengths`; shapes are kept."""
        if not isinstance(values, Mapping):
            values = {s.name: float(x) for s, x in zip(self.strengths, values, strict=True)}
        kept = {s.name: self.values[s.name] for s in self.shapes if s.name in self.values}
        return type(self)(self.at, kept | dict(values))

    @property
    def vector(self) -> Array:
        """Values in the order of `strengths`, (k,); what was not given is at its nominal value."""
        return np.array([self.values.get(s.name, s.nominal) for s in self.strengths], dtype=float)

    def unit(self, strength: Strength, tree: Tree) -> str:
        """The strength's unit at this place."""
        if self.place is Place.CHANNEL:
            return strength.unit.replace(CHANNEL_UNIT, channel_unit(self.at, tree))
        if strength.linear_unit is not None and self.place in (Place.JOINT, Place.ACTUATOR):
            return strength.linear_unit if tree.joints[tree.joint_index(self.at)].prismatic else strength.unit
        return strength.unit

    @classmethod
    def places(cls, tree: Tree) -> Iterator[str]:
        """Where in `tree` the effect can be looked for; contact and channel effects ask their scene instead."""
        if cls.place in (Place.JOINT, Place.ACTUATOR):
            yield from tree.joint_names
        elif cls.place is Place.BODY:
            yield from (body.name for body in tree.bodies if body.joint >= 0 and body.mass > 0)
        elif cls.place is Place.WORLD:
            yield "world"

    def directions(self) -> tuple[Direction, ...]:
        """Steps along which the effect is nearly linear, where a screening starts; one a strength by default."""
        nominal = {s.name: s.nominal for s in self.strengths}
        steps = []
        for s in self.strengths:
            size = 0.1 * s.typical
            ahead, behind = nominal | {s.name: s.nominal + size}, nominal | {s.name: s.nominal - size}
            steps.append(Direction(ahead, behind, 2.0 * size))
        return tuple(steps)

    def from_directions(self, coefficients: Array) -> Self:
        """The effect that the coefficients (k,) of its `directions` stand for."""
        return self.with_values(
            {s.name: s.nominal + float(c) for s, c in zip(self.strengths, coefficients, strict=True)}
        )

    def reshaped(self) -> Iterator[Self]:
        """Where else a better fit may lie: the effect with each other value that its shapes may take."""
        for shape in self.shapes:
            for value in shape.grid:
                if value != self.values.get(shape.name, shape.nominal):
                    yield type(self)(self.at, {**self.values, shape.name: value})

    def between_shapes(self, ratio: float) -> Iterator[Self]:
        """The effect with each of its shapes `ratio` times as large, and as small, while the grid's ends hold it."""
        for shape in self.shapes:
            value = self.values.get(shape.name, shape.nominal)
            for scaled in (value * ratio, value / ratio):
                if shape.grid and shape.grid[0] <= scaled <= shape.grid[-1]:
                    yield type(self)(self.at, {**self.values, shape.name: scaled})

    def vanishing(self) -> tuple[Array, Array]:
        """(c,) what is zero where the effect is absent, and nowhere else, and its slope (c, k) by the strengths."""
        values = self.vector
        index = {s.name: i for i, s in enumerate(self.strengths)}
        coordinates, slopes = [], []
        for i, s in enumerate(self.strengths):
            if not s.amplitude:
                continue
            slope = np.zeros(len(values))
            slope[i] = 1.0
            coordinate = values[i] - s.nominal
            if s.through:
                by = index[s.through]
                slope[i], slope[by] = values[by], coordinate
                coordinate = coordinate * values[by]
            coordinates.append(coordinate)
            slopes.append(slope)
        return np.array(coordinates), np.array(slopes)

    def plausible(self) -> bool:
        """Whether the values can be physics: within their bounds, unless a law asks for more."""
        return all(s.lower <= self.values[s.name] <= s.upper for s in self.strengths)

    def sentence(self, tree: Tree) -> str:
        """What a report says of the effect and its strength."""
        strengths = ", ".join(
            f"{s.name.replace('_', ' ')} {short(value)} {self.unit(s, tree)}".removesuffix(" 1")
            for s, value in zip(self.strengths, self.vector, strict=True)
        )
        return f"{self.name.replace('_', ' ')} at {self.at} ({strengths})"
