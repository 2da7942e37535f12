"""Keys and values of the scenario format that this version does not support: they are refused, never ignored."""

from collections.abc import Collection, Mapping

from drake_cafim.errors import InputError

KEYS: Mapping[tuple[str, str], str] = {}
"""(dataclass of the schema, key) to the feature's name in messages."""
UNKNOWNS = ()
EFFECTS = ("contact_law",)


def refuse_key(kind: str, name: str, key: str) -> None:
    """Raises `InputError` where the key `name` of the schema's dataclass `kind` is not supported; `key` is its path."""
    if (kind, name) in KEYS:
        raise InputError(f"{key} is given, but {KEYS[kind, name]} is not supported by this version: leave the key out")


def refuse_value(value: object, waiting: Collection[str], key: str) -> None:
    """Raises `InputError` where `value` is among the unsupported ones, `waiting`; `key` names the file and the key."""
    if isinstance(value, str) and value in waiting:
        raise InputError(f"{key} is {value}, which is not supported by this version")
