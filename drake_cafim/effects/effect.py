"""The base class of all effects: a named physical law at a place of the model, with its parameters (strengths)."""

from abc import ABC
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.surroundings import Surroundings, SystemPlace
from drake_cafim.errors import InputError
from drake_cafim.numerics.rounding import short
from drake_cafim.typing import Array


class Place(Enum):
    """The kind of model element that an effect attaches to."""

    JOINT = "joint"
    ACTUATOR = "actuator"
    BODY = "body"
    WORLD = "environment"
    CONTACT = "contact"
    CHANNEL = "sensor"


CHANNEL_UNIT = "unit of the channel"


def channel_unit(column: str, tree: Tree) -> str:
    """The SI unit of a recording's column; `CHANNEL_UNIT` where `column` names a whole sensor of several units."""
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

    `typical` is its usual size in practice and the standard deviation of the weak prior that the evidence needs;
    `unit` holds for a revolute joint, `linear_unit` for a prismatic joint.
    """

    name: str
    unit: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    nominal: float = 0.0
    """The value at which the effect is absent."""
    inverse: bool = False
    """Whether the effect is absent at infinity instead. Its inverse is then zero, and to first order both are the same
    number of standard deviations from zero, so that one test against zero serves both."""
    linear_unit: str | None = None
    grid: tuple[float, ...] = ()
    """For a shape parameter: the values that the search tries."""
    amplitude: bool = True
    """Whether the effect is absent at the nominal value; if not, the parameter only shapes the law (as a width)."""
    through: str = ""
    """Name of the strength that this one is multiplied by in the law, as the mass for its position: only the product
    is zero where the effect is absent."""
    required: bool = False
    """Whether a scenario that states the effect must give this value, though the nominal one lies within the bounds."""
    choices: tuple[float, ...] = ()
    """The only values that it may take, where there are few (as ±1): chosen by the search and reported, not fitted."""
    names: tuple[str, ...] = ()
    """Names of the choices, by which a report and a scenario give them; none where they are numbers."""

    def named(self, value: float) -> float | str:
        """The name of a choice where choices have names, else the value itself."""
        return self.names[self.choices.index(value)] if self.names else value


@dataclass(frozen=True)
class Start:
    """A linear regressor of an effect: `columns` (N, c) of force; their coefficients are a nonlinear fit's start.

    `shape` holds the parameters that the columns were computed at and that the coefficients do not determine.
    """

    columns: Array
    shape: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Direction:
    """A finite-difference step of an effect's strengths, from `behind` to `ahead`, divided by `size`.

    The difference quotient is the regressor of one coefficient. `behind` None is the model without the effect.
    """

    ahead: Mapping[str, float]
    behind: Mapping[str, float] | None
    size: float


@dataclass(frozen=True)
class Episode:
    """The interval of an effect that acts once: from `start` to `stop` s, in one `recording`; None is in each."""

    start: float
    stop: float
    recording: str | None


class Acting(Protocol):
    """The model's physics as far as an effect needs it to insert itself (implemented by `scenario.physics.Physics`)."""

    @property
    def tree(self) -> Tree: ...
    @property
    def gravity(self) -> Array: ...
    @property
    def contacts(self) -> tuple[SphereContact, ...]: ...
    def with_part(self, part: str, effect: "Effect") -> Self:
        """A copy with `effect` appended to the tuple named `part`."""
        ...

    def changed(self, **parts: Any) -> Self:
        """A copy with the named fields replaced."""
        ...


P = TypeVar("P", bound=Acting)


@dataclass(frozen=True)
class Effect(ABC):
    """A physical law `at` a place of the model with parameter `values`; without values it is a hypothesis.

    Subclasses declare their properties as class attributes and override the method that computes their law.
    """

    at: str
    values: Mapping[str, float] = field(default_factory=dict)

    name: ClassVar[str]
    family: ClassVar[str]
    place: ClassVar[Place]
    kind: ClassVar[str] = ""
    """Name of the `kinds.ByKind` method that handles it; inherited from the base class among `kinds.KINDS`."""
    strengths: ClassVar[tuple[Strength, ...]]
    shapes: ClassVar[tuple[Strength, ...]] = ()
    """Parameters of the law besides the strengths, as the width of a smoothed sign; chosen from the grid of each."""
    shapes_about_values: ClassVar[bool] = False
    """Whether `restarts` varies the effect's present values, so that a new fit gives new values to try."""
    all_but_linear: ClassVar[bool] = False
    """Whether its force is nearly linear in its strengths for fixed shapes."""
    difference_step: ClassVar[float] = 1e-4
    """Step of finite differences with respect to the strengths, as a fraction of the typical size."""
    group: ClassVar[str | None] = None
    """Effects of one group are alternative laws of the same phenomenon: at most one of them acts at a place."""
    narrows: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    """Simpler laws of its group, which it is where a weighted sum of its strengths is zero: by name, the weights."""
    surprise: ClassVar[float] = 0.0
    """−2 ln of its prior odds relative to the other effects."""
    reference: ClassVar[str]
    alike: ClassVar[Mapping[str, str]] = {}
    """Names of effects that are easily confused with this one, each with the reason."""
    formula: ClassVar[str] = ""
    """The law as HTML; if empty, a report shows the first line of the class's docstring."""
    words: ClassVar[str] = ""
    """What it does, as the predicate of a sentence whose subject is its name."""
    shown_over: ClassVar[str] = "time"
    """Abscissa of the law's plot in a report: time, variable (of a joint), position, load, acceleration or effort."""
    brief: ClassVar[bool] = False
    """Whether it acts once: a scenario then gives `interval: [start, stop]` and may name its `recording`."""
    in_throws: ClassVar[bool] = True
    """Whether it is a hypothesis for recordings of a thrown body."""
    of_contact: ClassVar[bool] = False
    """Whether it changes contact forces and nothing else."""
    changes_inertia: ClassVar[bool] = False
    """Whether inertia or gravity is another under it, and with it the noise of motion in the equations."""
    late: ClassVar[bool] = False
    """Whether it is a sensor effect that records values, and their noise, at a shifted or filtered time."""
    bounds_effort: ClassVar[bool] = False
    """Whether it takes off what an actuator's effort is beyond its bounds, and nothing else."""
    needs_motion: ClassVar[bool] = False
    """Whether it acts through changes of a motion or an effort alone: at a joint that rests, these are noise that a
    controller feeds back, and go with the noise of the samples."""
    slips: ClassVar[tuple[float, ...]] = ()
    """Displacements, rad or m, over which its force may build up after the motion turns round: what a search tries."""
    impacts: ClassVar[bool] = False
    """Whether it acts by impacts: a change of any parameter shifts their times, so that linearization is poor."""

    def __post_init__(self) -> None:
        known = [strength.name for strength in (*self.strengths, *self.shapes)]
        wrong = sorted(set(self.values) - set(known))
        if wrong:
            valid = ", ".join(known)
            raise InputError(f"effect {self.name} at {self.at}: unknown parameter {', '.join(wrong)}; valid: {valid}")

    @property
    def key(self) -> tuple[str, str]:
        """(name, place): identifies the effect in a model."""
        return (self.name, self.at)

    def excludes(self, other: "Effect") -> bool:
        """Whether both cannot act together: the same effect, or one of the same group, at the same place."""
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
        """Values in the order of `strengths`, (k,); nominal where no value is given."""
        return np.array([self.values.get(s.name, s.nominal) for s in self.strengths], dtype=float)

    def unit(self, strength: Strength, tree: Tree) -> str:
        """The SI unit of `strength` at this effect's place."""
        if self.place is Place.CHANNEL:
            return strength.unit.replace(CHANNEL_UNIT, channel_unit(self.at, tree))
        if strength.linear_unit is not None and self.place in (Place.JOINT, Place.ACTUATOR):
            return strength.linear_unit if tree.joints[tree.joint_index(self.at)].prismatic else strength.unit
        return strength.unit

    @property
    def law_table(self) -> Mapping[str, Sequence[float | str]]:
        """Columns of the file that states its law in a scenario; empty where its parameters do."""
        return {}

    @property
    def table(self) -> str:
        """Name of that file; empty where there is none."""
        return ""

    @property
    def settling(self) -> float | None:
        """Time constant s with which its state before the first sample decays; None for an effect without a state."""
        return None

    @property
    def episode(self) -> Episode | None:
        """The interval in which it acts; None for always."""
        return None

    def during(self, start: float, stop: float, recording: str | None) -> Self:
        """The same effect from `start` to `stop` s in one recording, None for each; `TypeError` unless `brief`."""
        raise TypeError(f"effect {self.name}: it acts at all times and takes no interval")

    def add_to(self, physics: P) -> P:
        """A copy of `physics` that includes the effect; `TypeError` where the class does not define how."""
        raise TypeError(f"effect {self.name}: {type(self).__name__} does not define how it enters the physics")

    def system(self, place: SystemPlace) -> Any:
        """A custom LeafSystem with the ports of its kind's systems; None to use the default system of its kind."""
        return None

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        """The places where it is a hypothesis, in a robot or in a thrown body."""
        if where.thrown is None:
            yield from cls.places(where.tree)
        elif cls.in_throws and cls.place in (Place.BODY, Place.WORLD):
            yield where.thrown if cls.place is Place.BODY else "world"

    @classmethod
    def places(cls, tree: Tree) -> Iterator[str]:
        """The places in `tree` where it is a hypothesis; contact and channel effects override `attachments`."""
        if cls.place in (Place.JOINT, Place.ACTUATOR):
            yield from tree.joint_names
        elif cls.place is Place.BODY:
            yield from (body.name for body in tree.bodies if body.joint >= 0 and body.mass > 0)
        elif cls.place is Place.WORLD:
            yield "world"

    def directions(self) -> tuple[Direction, ...]:
        """Steps along which the effect is nearly linear, for screening; by default one central step per strength."""
        nominal = {s.name: s.nominal for s in self.strengths}
        steps = []
        for s in self.strengths:
            size = 0.1 * s.typical
            ahead, behind = nominal | {s.name: s.nominal + size}, nominal | {s.name: s.nominal - size}
            steps.append(Direction(ahead, behind, 2.0 * size))
        return tuple(steps)

    def from_directions(self, coefficients: Array) -> Self:
        """The effect whose strengths follow from the coefficients (k,) of its `directions`."""
        return self.with_values(
            {s.name: s.nominal + float(c) for s, c in zip(self.strengths, coefficients, strict=True)}
        )

    def restarts(self) -> Iterator[Self]:
        """Further starts of a fit: the effect with each other value on the grid of each shape."""
        for shape in self.shapes:
            for value in shape.grid:
                if value != self.values.get(shape.name, shape.nominal):
                    yield type(self)(self.at, {**self.values, shape.name: value})

    def restarts_under_servo(self) -> Iterator[Self]:
        """Further starts of a fit at a joint that a servo drives."""
        yield from self.restarts()

    def between_shapes(self, ratio: float) -> Iterator[Self]:
        """The effect with each shape multiplied and divided by `ratio`, as long as it stays within the grid's ends."""
        for shape in self.shapes:
            value = self.values.get(shape.name, shape.nominal)
            for scaled in (value * ratio, value / ratio):
                if shape.grid and shape.grid[0] <= scaled <= shape.grid[-1]:
                    yield type(self)(self.at, {**self.values, shape.name: scaled})

    @property
    def is_absent(self) -> bool:
        """Whether a strength without which the effect does nothing is at the bound where it is absent."""
        lasting = (s for s in self.strengths if s.amplitude and not s.inverse)
        return any(self.values[s.name] == s.nominal == s.lower for s in lasting)

    def vanishing(self) -> tuple[Array, Array]:
        """Coordinates (c,) that are all zero only where the effect is absent, and their Jacobian (c, k) in the
        strengths.
        """
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

    def contradiction(self) -> str:
        """Why values that are each within their bounds are invalid together, as a clause; empty if they are valid."""
        return ""

    def contradiction_in(self, tree: Tree) -> str:
        """Why the values are impossible in `tree`, which includes the effect, as a clause; empty if they are not."""
        return ""

    def plausible(self) -> bool:
        """Whether the values are physically possible: within their bounds, and further conditions of the law."""
        return all(s.lower <= self.values[s.name] <= s.upper for s in self.strengths)

    def bounds_of(self, strength: Strength) -> tuple[float, float]:
        """The least and the largest value of a strength, the other values being what they are."""
        return strength.lower, strength.upper

    @property
    def choices(self) -> Mapping[Strength, float]:
        """The law's parameters that take one of a few values, such as a side, with their values."""
        return {s: float(self.values.get(s.name, s.nominal)) for s in self.shapes if s.choices}

    def stated(self, parameter: str, value: float) -> float | str:
        """The value of a parameter as a report states it: the name of a choice that has one."""
        return next((s.named(value) for s in self.shapes if s.name == parameter), value)

    @classmethod
    def numbers(cls, shown: Mapping[str, float | str]) -> dict[str, float]:
        """The values of parameters that a report or a scenario states, choices by their names.

        Raises `InputError` for a name that no choice of the parameter has.
        """
        named = {s.name: s for s in cls.shapes if s.names}
        result = {}
        for name, value in shown.items():
            if name not in named:
                result[name] = float(value)
                continue
            valid = dict(zip(named[name].names, named[name].choices, strict=True))
            if value not in valid:
                raise InputError(f"{cls.name}.{name} is {value}, expected one of {', '.join(valid)}")
            result[name] = valid[str(value)]
        return result

    def sentence(self, tree: Tree) -> str:
        """The effect, its place and its parameters with units, as a report prints them."""
        strengths = ", ".join(
            f"{s.name.replace('_', ' ')} {short(value)} {self.unit(s, tree)}".removesuffix(" 1")
            for s, value in zip(self.strengths, self.vector, strict=True)
        )
        chosen = ((s.name, s.named(value)) for s, value in self.choices.items())
        strengths += "".join(f", {name} {value if isinstance(value, str) else f'{value:+g}'}" for name, value in chosen)
        return f"{self.name.replace('_', ' ')} at {self.at} ({strengths})"
