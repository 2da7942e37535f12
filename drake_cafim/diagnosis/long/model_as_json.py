"""A model as plain values, for what a diagnosis in parts keeps, see `drake_cafim.kept`."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.effects.effect import Effect
from drake_cafim.scene.scene import Scene


def model_as_json(model: Model, scene: Scene) -> dict[str, Any] | None:
    """The model as plain values; None where an effect's class is not of the scene's vocabulary."""
    classes = {kind.name: kind for kind in scene.vocabulary}
    if any(type(effect) is not classes.get(effect.name) for effect in model.effects):
        return None
    return {
        "unknown": model.unknown.tolist(),
        "effects": [
            {"effect": effect.name} | {field.name: _plain(getattr(effect, field.name)) for field in fields(effect)}
            for effect in model.effects
        ],
        "free": [scene.unknown.index(unknown) for unknown in model.free],
        "held": model.held,
    }


def model_from_json(raw: Mapping[str, Any], scene: Scene) -> Model:
    """The model that `model_as_json` wrote."""
    classes = {kind.name: kind for kind in scene.vocabulary}

    def effect(own: Mapping[str, Any]) -> Effect:
        return classes[own["effect"]](**{name: value for name, value in own.items() if name != "effect"})

    free = tuple(scene.unknown[index] for index in raw["free"])
    unknown = np.array(raw["unknown"], dtype=float)
    return Model(unknown, tuple(effect(own) for own in raw["effects"]), free, bool(raw["held"]))


def _plain(value: Any) -> Any:
    return {name: float(number) for name, number in value.items()} if isinstance(value, Mapping) else value
