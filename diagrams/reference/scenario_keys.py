"""The keys of a scenario file as tables: type, default, range, unit and meaning."""

import dataclasses as dc
import inspect
import types
import typing
from typing import Any

from drake_cafim.contact.law import ContactLaw
from drake_cafim.diagrams.reference.field_comments import field_comments
from drake_cafim.diagrams.reference.tables import code, table
from drake_cafim.numerics.ranges import LARGEST, Range
from drake_cafim.recordings.topics import Topic
from drake_cafim.scenario import schema
from drake_cafim.scenario.inertials import INERTIALS
from drake_cafim.scenario.servos import SERVO_PARAMETERS
from drake_cafim.scenario.unknown import (
    BODY_PARAMETERS,
    CONTACT_PARAMETERS,
    DRY_FRICTION,
    JOINT_PARAMETERS,
    SIZES,
    STATED_PARAMETERS,
)

SECTIONS: dict[str, type] = {
    "": schema.Scenario,
    "weld[]": schema.Weld,
    "channels.<name>": schema.Channel,
    "channels.<name>.lowpass": schema.Lowpass,
    "unknown[]": schema.Unknown,
    "contact[]": schema.ContactPair,
    "contact[].ground": schema.Ground,
    "effects[]": schema.EffectEntry,
    "servo": schema.ServoEntry,
    "servo.supply": schema.Supply,
    "topics.<name>": Topic,
}
"""The dataclasses of the schema by their place in the file."""
REQUIRED = {
    ("Scenario", "model"),
    ("Weld", "body"),
    ("Unknown", "parameter"),
    ("Unknown", "std"),
    ("ContactPair", "bodies"),
    ("ContactPair", "stiffness"),
    ("EffectEntry", "effect"),
    ("EffectEntry", "at"),
    ("Supply", "column"),
}
_WORDS = {str: "text", float: "number", bool: "true or false", int: "whole number"}
PLACES = {
    "body": {**BODY_PARAMETERS, INERTIALS: "1", **SIZES},
    "joint": {**JOINT_PARAMETERS, **STATED_PARAMETERS, **SERVO_PARAMETERS},
    "contact": CONTACT_PARAMETERS,
}
PARAMETERS = {
    "mass": "the inertia scales with it, the centre of mass stays",
    "inertia": "a factor of the model's inertia about the centre of mass",
    INERTIALS: "all ten together, physically consistent; the std is relative, and `body` may be `all`",
    "length": "of a box, along its x",
    "width": "of a box, along its y",
    "height": "of a box, along its z",
    "radius": "of a sphere",
    DRY_FRICTION: "of a joint for which the model's file states one",
    "servo_stiffness": "kp under `servo:`; where that is a multiple of a column, its `scale`",
    "servo_damping": "kv",
    "servo_limit": "the limit of kp (cmd − q)",
}


def scenario_keys() -> str:
    """One table for each part of the file, and those of what `unknown:` may name and of the laws of contact."""
    parts = [_section(place, kind) for place, kind in SECTIONS.items()]
    return "\n\n".join([*parts, _unknowns(), _laws()])


def _section(place: str, kind: type) -> str:
    title = f"### `{place}`" if place else "### The file"
    comments = field_comments(kind)
    hints = typing.get_type_hints(kind)
    rows = [
        [
            code(f.name),
            "number or " * ("plain" in f.metadata) + _type(hints[f.name]),
            _default(kind, f),
            _range(f),
            comments[f.name],
        ]
        for f in dc.fields(kind)
    ]
    about = inspect.getdoc(kind) or ""
    return f"{title}\n\n{about}\n\n" + table(["key", "type", "default", "range", "meaning"], rows)


def _type(kind: Any) -> str:
    """The type in words, as "list of texts"."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(argument) for argument in arguments if argument is not type(None)))
    if dc.is_dataclass(kind):
        return next(f"`{place}`" for place, section in SECTIONS.items() if section is kind)
    if origin is list:
        return f"list of {_several(arguments[0])}"
    if origin is dict:
        return f"mapping to {_several(arguments[1])}" if arguments[1] is not Any else "mapping"
    return _WORDS.get(kind, "mapping")


def _several(kind: Any) -> str:
    return _type(kind) if dc.is_dataclass(kind) else f"{_type(kind)}s"


def _default(kind: type, field: "dc.Field[Any]") -> str:
    if (kind.__name__, field.name) in REQUIRED:
        return "**required**"
    value = field.default_factory() if field.default_factory is not dc.MISSING else field.default
    return "" if value in ("", None, [], {}) else code(f"{value:g}" if isinstance(value, float) else str(value))


def _range(field: "dc.Field[Any]") -> str:
    """The bounds of its numbers, with their unit."""
    within: Range = field.metadata.get("range", Range())
    unit = "" if within.unit in ("", "1") else f" {within.unit}"
    if within.least == -within.most:
        return f"± {within.most:g}{unit}" if within.most < LARGEST else unit.strip()
    least = "" if within.least <= -LARGEST else f"{'>' if within.above else '≥'} {within.least:g}"
    most = "" if within.most >= LARGEST else f"≤ {within.most:g}"
    return (", ".join(part for part in (least, most) if part) + unit).strip()


def _unknowns() -> str:
    rows = [
        [code(name), place, "" if unit == "1" else unit, PARAMETERS.get(name, "")]
        for place, parameters in PLACES.items()
        for name, unit in parameters.items()
    ]
    head = """### What `unknown:` may name

Also each parameter of an effect, with `effect` and `at`, as `{effect: payload, at: link7, parameter: mass, std: 1.0}`.
The effect need not stand under `effects:`; its other parameters then are at the values without effect."""
    return f"{head}\n\n" + table(["parameter", "of a", "unit", ""], rows)


def _laws() -> str:
    laws = {
        "kelvin_voigt": "λ = max(0, K d + C ḋ) where d > 0",
        "paper": "λ = max(0, K d − C abs(ḋ)), as the paper prints it",
        "hunt_crossley": "λ = K d max(0, 1 + c ḋ) where d > 0",
        "hydroelastic": "Drake's pressure field, of a soft sphere of radius R on a rigid plane "
        "λ = π E d² (1 − 2 d/(3 R)) max(0, 1 + c ḋ) where d > 0; of a rigid sphere on a soft box with half_extent H, "
        "λ = π E R/H d² (1 − d/(3 R)) max(0, 1 + c ḋ)",
    }
    rows = [[code(law), laws[ContactLaw(law).normal]] for law in schema.LAWS]  # type: ignore[arg-type]
    head = "### The laws of contact\n\nThe normal force λ at the penetration d, which grows at ḋ."
    return f"{head}\n\n" + table(["law", "normal force"], rows)
