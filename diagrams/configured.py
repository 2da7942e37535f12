"""Reads the section `diagram:` of a scenario file into a configuration dataclass."""

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed

from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import load

Config = TypeVar("Config")


def load_section(path: Path, defaults: Config) -> Config:
    """`defaults` with the values of the section `diagram:` of the scenario file at `path`.

    Raises `InputError`, which names the file, for a key or value that the configuration does not have.
    """
    return configured(load(path).diagram, defaults, str(path))


def configured(section: dict[str, Any], defaults: Config, source: str) -> Config:
    """`defaults` with the values of `section`, except its key `world`, the name of the packaged world."""
    values = {key: value for key, value in section.items() if key != "world"}
    try:
        config: Config = yaml_load_typed(schema=type(defaults), data=yaml.safe_dump(values), defaults=defaults)
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"{source}: diagram: {' '.join(str(error).split())}") from None
    return config
