"""Reading of a report.json: its JSON, and the types of the fields that commands use."""

import json
import math
from pathlib import Path
from typing import Any

from drake_cafim.errors import InputError

DEPTH = 40
"""Largest depth to which a report nests; ours have a quarter of it."""
_NUMBER = (int, float)
_EFFECT = {"effect": str, "at": str, "parameters": {"*": {"value": (*_NUMBER, str)}}}
_SHAPE: dict[str, Any] = {
    "schema": str,
    "verdict": str,
    "sentence": str,
    "explanation": [_EFFECT],
    "rivals": [{**_EFFECT, "parameter": str, "probability": _NUMBER}],
    "parameters": [{"parameter": str, "at": str, "effect": str, "value": _NUMBER}],
    "mismatch": {"locations": [{"kind": str, "name": str, "share": _NUMBER}]},
    "noise": {"*": {"std": _NUMBER, "correlation_time": _NUMBER}},
    "files": {"*": (str, list)},
    "data_mistakes": [str],
    "trace": [
        {
            **{"step": str, "asked": str, "passed": bool, "words": str},
            **{"statistic": _NUMBER, "threshold": _NUMBER, "others": [str]},
        }
    ],
}
"""Types of the fields that are read; `*` stands for every key of a mapping. All may be null or absent here."""
_REQUIRED = {"explanation": ("effect", "at"), "rivals": ("at",), "parameters": ("parameter", "at", "value")}
_REQUIRED |= {"locations": ("name", "share"), "noise": ("std",), "trace": ("step", "asked", "passed", "words")}
_WORDS = {str: "a text", bool: "true or false", int: "a number", list: "a list", dict: "a mapping"}


def report_file(path: Path) -> Path:
    """The report.json that `path` is, or that is in the folder `path`."""
    return path / "report.json" if path.is_dir() else path


def read_report(path: Path, source: str) -> dict[str, Any]:
    """The report in the file `path`, called `source` in messages.

    Raises `InputError` for a file that is no report, and for one of whose fields the commands could not make sense.
    """
    content = read_json(path, source, "a report.json")
    if not isinstance(content, dict) or not str(content.get("schema", "")).startswith("drake_cafim.report/"):
        raise InputError(f"{source}: its schema is not drake_cafim.report/1, expected a report.json")
    _check(content, _SHAPE, source, "")
    return content


def read_json(path: Path, source: str, expected: str) -> Any:
    """The contents of a JSON file, called `source`. Raises `InputError` for one that is none or nests too deeply."""
    try:
        if path.exists() and not path.is_file():  # a pipe would never end
            raise InputError(f"{source}: it is no regular file, expected {expected}")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{source}: it cannot be read ({error.strerror}), expected {expected}") from None
    except RecursionError:
        raise InputError(f"{source}: it nests too deeply, expected {expected}") from None
    except ValueError as error:
        raise InputError(f"{source}: it is no JSON ({error}), expected {expected}") from None
    if _is_deeper(content, DEPTH):
        raise InputError(f"{source}: it nests more than {DEPTH} deep, expected {expected}")
    return content


def read_record(path: Path, expected: str) -> dict[str, Any]:
    """The mapping in a JSON file that an earlier command left. Raises `InputError` for any other file."""
    content = read_json(path, str(path), expected)
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {type(content).__name__}, expected {expected}")
    return content


def _is_deeper(content: Any, depth: int) -> bool:
    level = [content]
    for _ in range(depth):
        level = [
            inner
            for item in level
            if isinstance(item, dict | list)
            for inner in (item.values() if isinstance(item, dict) else item)
        ]
    return bool(level)


def _check(value: Any, shape: Any, source: str, name: str) -> None:
    """Raises `InputError` where `value` is not null and not of the types of `shape`; `name` is its path within it."""
    if value is None:
        return
    if isinstance(shape, dict):
        _require(value, dict, source, name)
        own = name.rpartition(".")[2].partition("[")[0]
        for key, item in value.items():
            _check(item, shape.get(key, shape.get("*", object)), source, f"{name}.{key}" if name else key)
        required = _REQUIRED.get(own, ()) if "*" not in shape else ()
        lacking = [key for key in required if value.get(key) is None]
        if lacking:
            raise InputError(f"{source}: {name} is damaged, it has no {lacking[0]}; expected a report.json of cafim")
    elif isinstance(shape, list):
        _require(value, list, source, name)
        for i, item in enumerate(value):
            if item is None:
                raise InputError(f"{source}: {name}[{i}] is null, expected a report.json of cafim")
            _check(item, shape[0], source, f"{name}[{i}]")
    else:
        _require(value, shape, source, name)
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{source}: {name} is {value}, expected a finite number")


def _require(value: Any, kind: Any, source: str, name: str) -> None:
    kinds = kind if isinstance(kind, tuple) else (kind,)
    fits = isinstance(value, kinds) and (bool in kinds or object in kinds or not isinstance(value, bool))
    if fits and isinstance(value, int) and abs(value) > 10**15:
        fits = False
    if not fits:
        words = " or ".join(dict.fromkeys(_WORDS.get(kind, "a number") for kind in kinds))
        raise InputError(f"{source}: {name} is {str(value)[:60]}, expected {words}")
