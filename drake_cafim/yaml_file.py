"""Reading of a YAML file as plain mappings, lists, texts and numbers, and writing of what was read as YAML."""

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from drake_cafim.errors import InputError

MOST = 100_000
"""Largest number of values in a file, where aliases are written out: a scenario has some hundred."""
DEPTH = 40
"""Largest depth to which collections nest; a scenario's nest six deep."""


def read_mapping(path: Path, expected: str) -> dict[str, Any]:
    """The mapping in the file at `path`; `expected` tells in messages what the file should be.

    Raises `InputError` for a file that cannot be read, is not a mapping in YAML, has a key twice, nests too deeply,
    refers to itself, becomes too large by its aliases or holds a number with too many digits.
    """
    try:
        raw = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
        _measure(raw, {})
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file, expected {expected}") from None
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}), expected {expected}") from None
    except RecursionError:
        raise InputError(f"{path}: it nests too deeply, expected {expected}") from None
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{path}: not readable as YAML: {' '.join(str(error).split())}") from None
    if not isinstance(raw, dict):
        raise InputError(f"{path}: found {type(raw).__name__}, expected {expected}")
    return raw


def _measure(value: Any, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """The number of values in `value`, aliases written out, and the depth to which they nest.

    `known` are those of the collections that were measured, by `id`; one that is being measured has none yet. Raises
    `YAMLError` for more than `MOST` values, a depth above `DEPTH`, and a collection within itself.
    """
    if isinstance(value, Tagged):
        return _measure(value.value, known)
    if not isinstance(value, dict | list | tuple | set):
        return 1, 0
    if id(value) in known:
        if not known[id(value)][0]:
            raise yaml.YAMLError("a collection holds itself, by an alias to it")
        return known[id(value)]
    known[id(value)] = 0, 0
    inner = [*value, *value.values()] if isinstance(value, dict) else value
    measures = [_measure(item, known) for item in inner]
    count = 1 + sum(number for number, _ in measures)
    depth = 1 + max((deep for _, deep in measures), default=0)
    if count > MOST:
        raise yaml.YAMLError(f"its aliases make more than {MOST} values of it")
    if depth > DEPTH:
        raise yaml.YAMLError(f"it nests more than {DEPTH} deep")
    known[id(value)] = count, depth
    return count, depth


@dataclass(frozen=True)
class Tagged:
    """A value with a tag of the file's own, as Drake's `!Rpy {deg: [0, 0, 90]}`."""

    tag: str
    value: Any

    def __repr__(self) -> str:
        return f"{self.tag} {self.value!r}"


def dump(value: Any) -> str:
    """The YAML text of what `read_mapping` has read, tags included."""
    text: str = yaml.dump(value, Dumper=_Dumper)
    return text


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    def ignore_aliases(self, data: Any) -> bool:
        """No anchors in the text: Drake's parser need not resolve them."""
        return True

    def represent_tagged(self, data: Tagged) -> yaml.Node:
        node = self.represent_data(data.value)
        node.tag = data.tag
        return node


_Dumper.add_representer(Tagged, _Dumper.represent_tagged)


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """A loader that refuses equal keys; PyYAML's own uses the last of them without a warning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                where = f"line {key_node.start_mark.line + 1}"
                raise yaml.YAMLError(f"{where}: the key {key!r} is given twice")
            if isinstance(key, Hashable):
                seen.add(key)
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping

    def construct_tagged(self, suffix: str, node: yaml.Node) -> Tagged:
        if isinstance(node, yaml.MappingNode):
            return Tagged(f"!{suffix}", self.construct_mapping(node, deep=True))
        if isinstance(node, yaml.SequenceNode):
            return Tagged(f"!{suffix}", self.construct_sequence(node, deep=True))
        return Tagged(f"!{suffix}", self.construct_scalar(node))


_Loader.add_multi_constructor("!", _Loader.construct_tagged)
