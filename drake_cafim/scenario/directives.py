"""Check of Drake's model directives before its parser sees them: their form, and that no file includes itself."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_cafim.description.packages import Packages
from drake_cafim.errors import InputError
from drake_cafim.yaml_file import read_mapping

KINDS = {
    "add_model": ("name", "file"),
    "add_model_instance": ("name",),
    "add_frame": ("name",),
    "add_weld": ("parent", "child"),
    "add_collision_filter_group": ("name",),
    "add_directives": ("file",),
}
"""Drake's directives, and those of their keys that must be texts."""
EXPECTED = "Drake's model directives: a mapping with the key directives"
MOST_FILES = 1000
"""Largest number of files that directives add, those that are added several times counted as often."""


def check_directives(directives: Any, source: str, near: Path, packages: Packages) -> list[dict[str, Any]]:
    """`directives`, checked with all files of directives that they add, as far as those are found.

    `near` is the file that they stand in. Raises `InputError` for what is no list of directives, and for files that
    add themselves, which Drake's parser does not survive.
    """
    _check(directives, source, near, packages, (near.resolve(),), [])
    found: list[dict[str, Any]] = directives
    return found


def _check(
    directives: Any, source: str, near: Path, packages: Packages, above: Sequence[Path], added: list[Path]
) -> None:
    if not isinstance(directives, list) or not directives:
        found = type(directives).__name__ if directives else "none"
        raise InputError(f"{source}: directives holds {found}, expected a list of Drake's model directives")
    for i, directive in enumerate(directives):
        key = f"{source}: directives[{i}]"
        if not isinstance(directive, dict) or len(directive) != 1 or not KINDS.keys() & directive.keys():
            found = ", ".join(map(str, directive)) if isinstance(directive, dict) else type(directive).__name__
            raise InputError(f"{key} holds {found or 'nothing'}, expected one of {', '.join(KINDS)}")
        ((kind, entry),) = directive.items()
        if not isinstance(entry, dict):
            raise InputError(f"{key}.{kind} is {type(entry).__name__}, expected a mapping")
        for name in KINDS[kind]:
            if not isinstance(entry.get(name), str) or not entry[name]:
                raise InputError(f"{key}.{kind}.{name} is {str(entry.get(name))[:60]}, expected a text")
        if kind == "add_directives":
            _check_added(entry["file"], f"{key}.{kind}.file", near, packages, above, added)


def _check_added(
    address: str, key: str, near: Path, packages: Packages, above: Sequence[Path], added: list[Path]
) -> None:
    path = packages.file(address, near)
    if path is None:  # in a package that only Drake knows, or not there, which its parser says
        return
    if path in above:
        raise InputError(f"{key} is {address}, which adds itself, directly or through other files")
    added.append(path)
    if len(added) > MOST_FILES:
        raise InputError(f"{key} is {address}: more than {MOST_FILES} files are added, expected fewer")
    content = read_mapping(path, EXPECTED)
    _check(content.get("directives"), str(path), path, packages, (*above, path), added)
