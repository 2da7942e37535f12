"""Configuration of a task or planning model by the values of a scenario file."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter, Parameters

Configured = TypeVar("Configured")


def configure(model: Configured, values: Mapping[str, Any], source: str) -> Configured:
    """A copy of the dataclass `model` with the `values` of fields by name, each of the type that the field has.

    `parameters` is a list of mappings with the fields of `Parameter`. Raises `InputError`, naming `source`
    (the file), for a key that is no field and for a value of another kind.
    """
    assert is_dataclass(model) and not isinstance(model, type)
    valid = [field.name for field in fields(model)]
    unknown = sorted(set(values) - set(valid))
    if unknown:
        raise InputError(f"{source}: unknown key {unknown[0]!r}, expected one of {', '.join(valid)}")
    changes = {key: _convert(getattr(model, key), value, f"{source}: {key}") for key, value in values.items()}
    return replace(model, **changes)


def _convert(present: Any, value: Any, where: str) -> Any:
    """`value` in the type of the field's `present` value; raises `InputError` that begins with `where` otherwise."""
    if isinstance(present, Parameters):
        return Parameters.of(_parameter(entry, where) for entry in value)
    if isinstance(present, (bool, str)) or present is None:
        kind: Any = type(present)
        if isinstance(value, kind):
            return value
    elif isinstance(present, int) and isinstance(value, int) and not isinstance(value, bool):
        return value
    elif isinstance(present, float) and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    elif isinstance(present, (tuple, np.ndarray)) and isinstance(value, list) and len(value) == len(present):
        numbers = [float(number) for number in value]
        return tuple(numbers) if isinstance(present, tuple) else np.array(numbers)
    elif isinstance(present, Mapping) and isinstance(value, Mapping):
        return {str(key): float(number) for key, number in value.items()}
    raise InputError(f"{where} is {value!r}, expected a value like {present!r}")


def _parameter(entry: Any, where: str) -> Parameter:
    valid = [field.name for field in fields(Parameter)]
    if not isinstance(entry, Mapping) or not {"name", "mean"} <= set(entry) <= set(valid):
        raise InputError(f"{where} holds {entry!r}, expected name, mean and any of {', '.join(valid[2:])}")
    return Parameter(**{str(key): value for key, value in entry.items()})
