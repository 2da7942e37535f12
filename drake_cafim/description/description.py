"""What a model file says, sorted: text that Drake's parser takes, and physics that it does not."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from drake_cafim.typing import Array

SHOWN = (".obj", ".gltf", ".glb", ".stl", ".dae")
"""Meshes that the replay shows."""


@dataclass(frozen=True)
class Acting:
    """An effect of the catalogue that the file says acts, as a friction in `<dynamics>`."""

    effect: str
    at: str
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: q = multiplier · q_leader + offset."""

    joint: str
    leader: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Shown:
    """A mesh that the replay shows at R (3, 3), p (3,) m in a body's frame; `color` red, green, blue, opacity."""

    body: str
    file: Path
    R: Array
    p: Array
    scale: tuple[float, ...]
    color: tuple[float, ...]


@dataclass(frozen=True)
class Description:
    """One model file, without its meshes' collisions.

    - `text` in Drake's `form`: what is left for its parser.
    - `acting`, `rotor_inertias` (kg m², by joint), `effort_limits` (N m, by joint), `mimics`: what the parser does not
      take, or not for every joint.
    - `notes`: what is not taken at all, or was mended, by name.
    - `places`: where bodies and joints stand, `file, line n` by name.
    - `positions` (rad, m) of the joints in the pose that the file draws, where they are not 0.
    - `shown`: meshes beside those in `text`.
    """

    text: str
    form: Literal["urdf", "sdf", "xml"]
    acting: tuple[Acting, ...] = ()
    rotor_inertias: Mapping[str, float] = field(default_factory=dict)
    effort_limits: Mapping[str, float] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    notes: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    shown: tuple[Shown, ...] = ()


@dataclass(frozen=True)
class Stated:
    """What the files of a scenario's model say beyond the parsed plant; fields as in `Description`."""

    acting: tuple[Acting, ...] = ()
    rotor_inertias: Mapping[str, float] = field(default_factory=dict)
    effort_limits: Mapping[str, float] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    notes: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    shown: tuple[Shown, ...] = ()


def stated(descriptions: Iterable[Description], notes: Iterable[str] = ()) -> Stated:
    """All files together; `notes` are of the parser."""
    found = list(descriptions)
    return Stated(
        acting=tuple(one for description in found for one in description.acting),
        rotor_inertias={name: value for one in found for name, value in one.rotor_inertias.items()},
        effort_limits={name: value for one in found for name, value in one.effort_limits.items()},
        mimics=tuple(one for description in found for one in description.mimics),
        notes=tuple(dict.fromkeys([*(note for one in found for note in one.notes), *notes])),
        places={name: place for one in found for name, place in one.places.items()},
        positions={name: value for one in found for name, value in one.positions.items()},
        shown=tuple(mesh for one in found for mesh in one.shown),
    )


def listed(names: Iterable[str]) -> str:
    """Names for a sentence: all of a few, of many the first and how many more."""
    known = list(dict.fromkeys(names))
    return ", ".join(known) if len(known) <= 8 else f"{', '.join(known[:6])} and {len(known) - 6} more"
