"""Reading of a YAML file as plain mappings, lists, texts and numbers."""

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from drake_cafim.errors import InputError


def read_mapping(path: Path, expected: str) -> dict[str, Any]:
    """The mapping in the file at `path`; `expected` tells in messages what the file should be.

    Raises `InputError` for a file that cannot be read, is not a mapping in YAML, has a key twice, nests too deeply
    or holds a number with too many digits.
    """
    try:
        raw = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
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


@dataclass
class Tagged:
    """A value under a tag of Drake's own, as `!Rpy {deg: [0, 0, 90]}` or `!IiwaDriver {}`, which is kept as it is."""

    tag: str
    value: Any


def write_yaml(content: Any) -> str:
    """The content as YAML, keys in their order, tags of Drake's included."""
    return str(yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True))


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


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    """A writer of `Tagged` values."""


def _construct_tagged(loader: _Loader, suffix: str, node: yaml.Node) -> Tagged:
    if isinstance(node, yaml.MappingNode):
        return Tagged(node.tag, loader.construct_mapping(node, deep=True))
    if isinstance(node, yaml.SequenceNode):
        return Tagged(node.tag, loader.construct_sequence(node, deep=True))
    return Tagged(node.tag, loader.construct_scalar(node))


def _represent_tagged(dumper: _Dumper, tagged: Tagged) -> yaml.Node:
    if isinstance(tagged.value, dict):
        return dumper.represent_mapping(tagged.tag, tagged.value)
    if isinstance(tagged.value, list):
        return dumper.represent_sequence(tagged.tag, tagged.value)
    return dumper.represent_scalar(tagged.tag, str(tagged.value))


_Loader.add_multi_constructor("!", _construct_tagged)
_Dumper.add_representer(Tagged, _represent_tagged)
