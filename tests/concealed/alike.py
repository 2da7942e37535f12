"""Whether a name of a report is that of a concealed effect, and whether its numbers are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Json = Mapping[str, Any]
NORMAL_95 = 1.959964


def same_place(place: str, other: str) -> bool:
    """Equal, or the same contact pair in the other order."""
    return place == other or ("/" in place and sorted(place.split("/")) == sorted(other.split("/")))


def matches(named: Sequence[str], effect: Json) -> bool:
    return named[0] == effect["effect"] and same_place(named[1], effect["at"])


def equivalent(effect: str, told: dict[str, float], true: dict[str, float]) -> dict[str, float]:
    """The told parameters in that of their equal forms that lies nearest to the truth."""
    forms = [told]
    if effect == "torque_ripple" and {"phase", "amplitude"} <= told.keys():
        turns = [2.0 * np.pi * k for k in (-2, -1, 0, 1, 2)]
        forms = [told | {"phase": told["phase"] + turn} for turn in turns]
        forms += [told | {"phase": told["phase"] + np.pi + turn, "amplitude": -told["amplitude"]} for turn in turns]
    if effect == "contact_anisotropic_friction" and {"angle", "friction_1", "friction_2"} <= told.keys():
        swapped = told | {
            "friction_1": told["friction_2"],
            "friction_2": told["friction_1"],
            "angle": told["angle"] + 0.5 * np.pi,
        }
        forms = [form | {"angle": form["angle"] + np.pi * k} for form in (told, swapped) for k in (-2, -1, 0, 1, 2)]
    key = "phase" if effect == "torque_ripple" else "angle"
    return min(
        forms,
        key=lambda form: sum(
            abs(form[name] - true[name]) for name in true if name in form and (name == key or len(forms) > 1)
        ),
    )


def covered_by(effect: Json, told: Mapping[str, tuple[float, float]]) -> list[list[Any]]:
    """Of each number of the effect: its name, whether its 95 % interval holds the truth, and how many stds off it is.

    `told` holds values and stds. Laws that the vocabulary does not state exactly have no true numbers.
    """
    if not effect.get("exact", True):
        return []
    true = {name: float(value[0]) for name, value in effect["parameters"].items()}
    values = equivalent(effect["effect"], {name: value for name, (value, _) in told.items()}, true)
    off = {name: (values[name] - true[name]) / told[name][1] for name in true if name in told and told[name][1]}
    return [[name, abs(z) <= NORMAL_95, z] for name, z in off.items()]
