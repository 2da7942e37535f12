"""The contents of a model file: the text for Drake's parser, and the physics that the parser does not read."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from drake_cafim.typing import Array

SHOWN = (".obj", ".gltf", ".glb", ".stl", ".dae")
"""Suffixes of the meshes that the replay can show."""


@dataclass(frozen=True)
class StatedEffect:
    """An effect of the catalogue that the file states, as a friction in `<dynamics>`; `at` is the joint."""

    effect: str
    at: str
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class StatedServo:
    """A position servo that the file states at a joint: effort = clip(stiffness (cmd − q), ±limit) − damping v."""

    joint: str
    stiffness: float
    damping: float
    limit: float


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: q = multiplier · q_leader + offset."""

    joint: str
    leader: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Closure:
    """A constraint called `name` that holds two bodies together, by which a chain of joints may close."""

    name: str
    body: str
    other: str


@dataclass(frozen=True)
class VisualMesh:
    """A mesh that the replay shows at R (3, 3), p (3,) m in a body's frame; `color` red, green, blue, opacity."""

    body: str
    file: Path
    R: Array
    p: Array
    scale: tuple[float, ...]
    color: tuple[float, ...]


@dataclass(frozen=True)
class Description:
    """The contents of one model file, without collision meshes.

    - `text`: what Drake's parser reads, in its format `form`.
    - `acting`, `rotor_inertias` (kg m², by joint), `effort_limits` (N m, by joint), `mimics`: what the parser does not
      read, or not for every joint.
    - `notes`: sentences on what is ignored or was corrected, with the names of joints and bodies.
    - `places`: `file, line n` of each body and joint, by name.
    - `positions` (rad, m): of joints whose position in the file's reference pose is not 0.
    - `shown`: visual meshes beside those in `text`.
    - `closures`: constraints between bodies, which the parser ignores.
    - `servos`: position servos of joints; `driven`: joints that actuators which the parser does not read drive.
    """

    text: str
    form: Literal["urdf", "sdf", "xml"]
    acting: tuple[StatedEffect, ...] = ()
    rotor_inertias: Mapping[str, float] = field(default_factory=dict)
    effort_limits: Mapping[str, float] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    notes: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    shown: tuple[VisualMesh, ...] = ()
    closures: tuple[Closure, ...] = ()
    servos: tuple[StatedServo, ...] = ()
    driven: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModelStatements:
    """What all files of a scenario's model state beyond the parsed plant; fields as in `Description`."""

    acting: tuple[StatedEffect, ...] = ()
    rotor_inertias: Mapping[str, float] = field(default_factory=dict)
    effort_limits: Mapping[str, float] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    notes: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    shown: tuple[VisualMesh, ...] = ()
    closures: tuple[Closure, ...] = ()
    servos: tuple[StatedServo, ...] = ()
    driven: tuple[str, ...] = ()


def combine_descriptions(descriptions: Iterable[Description], notes: Iterable[str] = ()) -> ModelStatements:
    """The statements of all files together; `notes` are those of the parser."""
    found = list(descriptions)
    return ModelStatements(
        acting=tuple(effect for file in found for effect in file.acting),
        rotor_inertias={name: value for file in found for name, value in file.rotor_inertias.items()},
        effort_limits={name: value for file in found for name, value in file.effort_limits.items()},
        mimics=tuple(mimic for file in found for mimic in file.mimics),
        closures=tuple(closure for file in found for closure in file.closures),
        notes=tuple(dict.fromkeys([*(note for file in found for note in file.notes), *notes])),
        places={name: place for file in found for name, place in file.places.items()},
        positions={name: value for file in found for name, value in file.positions.items()},
        shown=tuple(mesh for file in found for mesh in file.shown),
        servos=tuple(servo for file in found for servo in file.servos),
        driven=tuple(name for file in found for name in file.driven),
    )


def list_names(names: Iterable[str]) -> str:
    """The names as text for a sentence: up to 8 in full, of more the first 6 and the number of the others."""
    known = list(dict.fromkeys(names))
    return ", ".join(known) if len(known) <= 8 else f"{', '.join(known[:6])} and {len(known) - 6} more"


def describe_negative_damping(place: str, damping: float) -> str:
    """A note on a joint, which `place` names, whose damping drives it on, as that of a fit may; Drake refuses it."""
    return f"{place} has the damping {damping:g}, which would drive it on: 0 is used"
