"""Search for the folders of packages in `package://` addresses."""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drake_cafim.description.xml_document import read_document
from drake_cafim.errors import InputError

SEARCHED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
_ADDRESS = re.compile(r"(?:package|model)://([^/]+)/?(.*)")


@dataclass(frozen=True)
class Packages:
    """Finds packages: `given` folders by name first, then folders above a file, then ROS's environment variables."""

    given: Mapping[str, Path] = field(default_factory=dict)

    def find(self, name: str, near: Path) -> Path | None:
        """The folder of package `name`: as given, or with a package.xml above the file `near`, or installed for ROS."""
        if name in self.given:
            return self.given[name]
        for folder in near.resolve().parents:
            if (folder / "package.xml").is_file() and name in (folder.name, package_name(folder / "package.xml")):
                return folder
        return next((folder for folder in _installed(name) if os.path.isdir(folder)), None)

    def file(self, address: str, near: Path) -> Path | None:
        """The file that `address` in the file `near` refers to; None where it does not exist."""
        match = _ADDRESS.fullmatch(address)
        if match is None:
            path = near.parent / address.removeprefix("file://")
        else:
            folder = self.find(match.group(1), near)
            if folder is None:
                return None
            path = folder / match.group(2)
        return path.resolve() if os.path.isfile(path) else None

    def require_file(self, address: str, near: Path) -> Path:
        """The file that `address` refers to. Raises `InputError` that says how to give the package's folder."""
        found = self.file(address, near)
        if found is None:
            raise InputError(f"{address}: {self.explain_missing(address, near)}")
        return found

    def explain_missing(self, address: str, near: Path) -> str:
        """Why there is no file at the address, and what to do."""
        match = _ADDRESS.fullmatch(address)
        folder = self.find(match.group(1), near) if match else near.parent
        if match is not None and folder is None:
            return f"the package {match.group(1)!r} is not known; {explain_ways(match.group(1))}"
        return f"there is no such file in {folder}"


def explain_ways(name: str) -> str:
    """The ways to give the folder of the package `name`, for messages."""
    return (
        f"expected `packages: {{{name}: folder}}` in the scenario, --package {name}=DIR, its place in "
        f"{' or '.join(SEARCHED)}, or a package.xml of that name above the file"
    )


def package_name(manifest: Path) -> str:
    """The name that a package.xml gives its folder; empty for one that cannot be read."""
    try:
        return (read_document(manifest).root.findtext("name") or "").strip()
    except InputError:
        return ""


def _installed(name: str) -> Iterator[Path]:
    """The folders where ROS 2 and then ROS 1 would have the package, whether they exist or not."""
    for folder in _folders("AMENT_PREFIX_PATH"):
        yield folder / "share" / name
    for folder in _folders("ROS_PACKAGE_PATH"):
        if (folder / "package.xml").is_file() and name in (folder.name, package_name(folder / "package.xml")):
            yield folder
        yield folder / name


def _folders(variable: str) -> list[Path]:
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def package_folders(arguments: tuple[str, ...]) -> dict[str, str]:
    """Absolute folders by package name, from `NAME=DIR` of the command line. Raises `InputError` for anything else."""
    found = {}
    for argument in arguments:
        name, equals, folder = argument.partition("=")
        if not (name and equals and os.path.isdir(folder)):
            raise InputError(f"--package {argument}: expected NAME=DIR, a package's name and the folder it is in")
        found[name] = str(Path(folder).resolve())
    return found
