"""Check of YAML against the schema's dataclasses: keys, types and ranges of numbers, with the key's path in messages.

Paths are written `channels.q.std` and `effects[1].delay`; entries of lists count from 0.
"""

import dataclasses as dc
import difflib
import re
import types
import typing
from collections.abc import Mapping
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import ANY, Range

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_WORDS = {str: "a text", float: "a number", bool: "true or false", int: "a whole number"}


def conform(value: Any, kind: Any, key: str, name: str = "", metadata: Mapping[str, Any] | None = None) -> Any:
    """`value` in the type `kind`: numbers as floats, keys without a value left out.

    `kind` is a dataclass, a list or mapping of one type, `str`, `float`, `Any`, or a union of these with None. Messages
    begin with `key`, which names the file, and `name`, the path within it. A field's metadata may hold the `range` of
    its numbers, the `length` of its list, the key of a mapping that a `plain` number is for, and `flat` for a mapping
    whose keys the file writes beside those of the dataclass. Raises `InputError` for a value that does not fit.
    """
    metadata = metadata or {}
    where = f"{key}{name}"
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        # the type that the value has; a value of none of them fails against the first one, whose message says what fits
        fitting = [argument for argument in arguments if isinstance(value, typing.get_origin(argument) or argument)]
        chosen = fitting or [argument for argument in arguments if argument is not type(None)][:1]
        return None if value is None else conform(value, chosen[0], key, name, metadata)
    if kind is Any:
        return value
    if dc.is_dataclass(kind):
        return _dataclass(value, kind, key, name)
    if origin is list:
        return _list(value, arguments[0], key, name, metadata)
    if origin is dict:
        if "plain" in metadata and not isinstance(value, dict):
            return {metadata["plain"]: conform(value, arguments[1], key, name, metadata)}
        within = {} if "flat" in metadata else metadata
        items = _mapping(value, where).items()
        whole = dc.is_dataclass(arguments[1])  # `q:` alone names the channel, with the defaults of all its keys
        return {
            k: conform({} if v is None else v, arguments[1], key, _path(name, k), within)
            for k, v in items
            if whole or v is not None
        }
    if kind is float:
        return _number(value, where, metadata.get("range", ANY))
    if not isinstance(value, kind):
        hint = ", in quotes" if kind is str and isinstance(value, int | float) else ""
        raise InputError(f"{where} is {brief(value)}, expected {_WORDS[kind]}{hint}")
    if kind is str and "\0" in value:  # no file and no column has it in its name
        raise InputError(f"{where} is {brief(value)}, expected a text without NUL")
    return value


def brief(value: Any) -> str:
    """The value as messages show it, cut to 60 characters."""
    if value is None:
        return "empty"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**30:
        return "a whole number of more than 30 digits"
    try:
        text = str(value) if isinstance(value, int | float) else repr(value)
    except RecursionError:
        return f"a {type(value).__name__} that nests too deeply"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _path(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where} is {brief(value)}, expected a mapping")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{where} has the key {brief(key)}, expected a text{'' if key is None else ', in quotes'}")
    return value


def _dataclass(value: Any, kind: Any, key: str, name: str) -> dict[str, Any]:
    """The mapping `value` with the fields of the dataclass `kind`; raises `InputError` for a key that is none."""
    fields = {field.name: field for field in dc.fields(kind)}
    hints = typing.get_type_hints(kind)
    flat = next((field.name for field in fields.values() if "flat" in field.metadata), None)
    found: dict[str, Any] = {}
    # the scenario itself has no name
    for own, item in _mapping(value, f"{key}{name}" if name else key.removesuffix(": ")).items():
        path = _path(name, own)
        if own == flat and item is not None:
            found.setdefault(flat, {}).update(conform(item, hints[own], key, path, fields[own].metadata))
        elif own in fields:
            if item is not None:
                found[own] = conform(item, hints[own], key, path, fields[own].metadata)
        elif flat is not None:
            if item is not None:
                found.setdefault(flat, {})[own] = _number(item, f"{key}{path}", ANY, finite=False)
        else:
            _refuse_unknown(own, tuple(fields), key, name)
    return found


def _refuse_unknown(own: str, valid: tuple[str, ...], key: str, name: str) -> None:
    near = difflib.get_close_matches(own, valid, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    inside = name or "the scenario"
    raise InputError(f"{key}unknown key {brief(own)} in {inside}{hint}; valid keys: {', '.join(valid)}")


def _list(value: Any, kind: Any, key: str, name: str, metadata: Mapping[str, Any]) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{key}{name} is {brief(value)}, expected a list")
    length = metadata.get("length")
    if length is not None and len(value) != length:
        raise InputError(f"{key}{name} is {brief(value)}, expected a list of {length}")
    return [conform(item, kind, key, f"{name}[{i}]", metadata) for i, item in enumerate(value)]


def _number(value: Any, where: str, allowed: Range, finite: bool = True) -> float:
    """The number within `allowed`; a text such as 1e-3, which YAML 1.1 does not read as a number, counts as one."""
    written = isinstance(value, str) and _NUMBER.fullmatch(value.strip())
    if isinstance(value, bool) or not (isinstance(value, int | float) or written):
        raise InputError(f"{where} is {brief(value)}, expected {allowed}")
    try:
        found = float(value)
    except OverflowError:
        raise InputError(f"{where} is {brief(value)}, expected {allowed}") from None
    if finite:
        allowed.check(found, where)
    return found
