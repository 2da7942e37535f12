"""What a diagnosis in parts has finished, on disk, so that one that was killed goes on where it ended.

A file for each finished piece of work, whole or not there: numbers alone, no code is read from them.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.effects.effect import Effect
from drake_cafim.output import replacing, write_text
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

ABOUT = "about.json"
"""What the kept work is of: another diagnosis in the same folder begins anew."""
UNREADABLE = (BadZipFile, OSError, EOFError, ValueError, KeyError, TypeError, IndexError, AttributeError)
"""Errors of a kept file that is gone or damaged: its work is done again."""
Found = TypeVar("Found")


@dataclass(frozen=True)
class Kept:
    """Finished work in `folder`, by name; without a folder none is kept."""

    folder: Path | None = None

    @classmethod
    def open(cls, folder: Path, about: Mapping[str, Any], resume: bool) -> "Kept":
        """The work in `folder` where it is to be resumed and is of the same `about`, else an empty folder."""
        text = json.dumps(about, indent=1) + "\n"
        try:
            same = resume and (folder / ABOUT).read_text(encoding="utf-8") == text
        except UNREADABLE:
            same = False
        if not same:
            shutil.rmtree(folder, ignore_errors=True)
            write_text(folder / ABOUT, text)
        return cls(folder)

    def close(self) -> None:
        """Remove what was kept: the results are there."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def read(self, name: str, parse: Callable[[Any], Found]) -> Found | None:
        """The work of that name as `parse` understands it; None where it is not there or damaged."""
        if self.folder is None:
            return None
        try:
            return parse(json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8")))
        except UNREADABLE:
            return None

    def write(self, name: str, content: Any) -> None:
        """Keep `content`, plain values, under that name; None is not kept."""
        if self.folder is not None and content is not None:
            write_text(self.folder / f"{name}.json", json.dumps(content))

    def read_arrays(self, name: str, parse: Callable[[Mapping[str, Array]], Found]) -> Found | None:
        """As `read`, of arrays by name."""
        if self.folder is None:
            return None
        try:
            with (self.folder / f"{name}.npz").open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return parse(dict(arrays))
        except UNREADABLE:
            return None

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays under that name."""
        if self.folder is not None:
            with replacing(self.folder / f"{name}.npz") as temporary:
                np.savez(temporary, **arrays)


NOTHING_KEPT = Kept()


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
