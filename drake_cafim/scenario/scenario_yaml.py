"""Writing of a scenario as a YAML file."""

import dataclasses as dc
import os
from pathlib import Path
from typing import Any

from drake_cafim.scenario.schema import Scenario
from drake_cafim.yaml_file import Tagged, dump


def as_yaml(scenario: Scenario, folder: Path, destination: Path) -> str:
    """The scenario as YAML for a file in the folder `destination`; its present paths are relative to `folder`."""
    raw = {key: value for key, value in _plain(scenario).items() if value not in (None, [], {}, "")}
    if scenario.model and not scenario.model.startswith("package://"):
        raw["model"] = os.path.relpath((folder / scenario.model).resolve(), destination.resolve())
    for name, place in raw.get("packages", {}).items():
        raw["packages"][name] = os.path.relpath((folder / place).resolve(), destination.resolve())
    if scenario.directives:
        raw["directives"] = [_moved(directive, folder, destination) for directive in scenario.directives]
    for channel in raw.get("channels", {}).values():
        if set(channel.get("std", {})) == {"all"}:
            channel["std"] = channel["std"]["all"]
    raw["effects"] = [
        {key: value for key, value in entry.items() if key != "parameters"} | entry.get("parameters", {})
        for entry in raw.get("effects", [])
    ]
    return dump(raw)


def _moved(directive: dict[str, Any], folder: Path, destination: Path) -> dict[str, Any]:
    """The directive with the relative address of a model file as seen from `destination`."""
    entry = directive.get("add_model")
    if not isinstance(entry, dict) or not isinstance(file := entry.get("file"), str) or "://" in file:
        return directive
    place = os.path.relpath((folder / file).resolve(), destination.resolve())
    return {**directive, "add_model": {**entry, "file": place}}


def _plain(value: Any) -> Any:
    """Nested dataclasses as mappings, without the fields that have their default value."""
    if dc.is_dataclass(value) and not isinstance(value, type | Tagged):
        result = {}
        for field in dc.fields(value):
            item = getattr(value, field.name)
            default = field.default_factory() if field.default_factory is not dc.MISSING else field.default
            if item != default:
                result[field.name] = _plain(item)
        return result
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value
