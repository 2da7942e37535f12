"""The section of a scenario file that configures its world."""

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed

from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import load

Config = TypeVar("Config")


def load_section(path: Path, defaults: Config) -> Config:
    """The section `diagram:` of the scenario file at `path`; what it lacks keeps its value in `defaults`.

    Raises `InputError` that names the file for what the section cannot hold.
    """
    return configured(load(path).diagram, defaults, str(path))


def configured(section: dict[str, Any], defaults: Config, source: str) -> Config:
    """`defaults` with the values of `section`; its key `world`, which says whose it is, is not among them."""
    values = {key: value for key, value in section.items() if key != "world"}
    try:
        config: Config = yaml_load_typed(schema=type(defaults), data=yaml.safe_dump(values), defaults=defaults)
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"{source}: diagram: {' '.join(str(error).split())}") from None
    return config
