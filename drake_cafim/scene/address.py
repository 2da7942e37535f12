"""Where a scenario is: a file, one of the scenarios in a file, or the name of a packaged one."""

import os
from pathlib import Path

from drake_cafim.errors import InputError
from drake_cafim.scenario.packaged import packaged_folder

DIAGRAMS = packaged_folder("diagrams")


def split_address(address: str) -> tuple[Path, str]:
    """The file, and the name of one of its scenarios, of FILE#NAME; the name is empty where the address is a file."""
    file, mark, name = address.rpartition("#")
    return (
        (Path(file), name) if mark and not os.path.isfile(address) and os.path.isfile(file) else (resolve(address), "")
    )


def resolve(address: str) -> Path:
    """The file of a packaged scenario's name, or the path itself.

    Raises `InputError` that lists the packaged names when there is neither.
    """
    packaged = sorted(path.stem for path in DIAGRAMS.glob("*.yaml"))
    if address in packaged:
        return DIAGRAMS / f"{address}.yaml"
    path = Path(address)
    if not os.path.isfile(path):
        names = ", ".join(packaged) or "none"
        raise InputError(f"{address}: there is no such file and no packaged scenario of that name (there are: {names})")
    return path
