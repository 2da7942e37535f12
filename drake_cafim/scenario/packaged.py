"""Folders of the packaged scenarios and models, in a wheel and in a checkout alike."""

from importlib import resources
from pathlib import Path


def packaged_folder(name: str) -> Path:
    """The folder of the subpackage `diagrams` or `models`."""
    return Path(str(resources.files(f"drake_cafim.{name}")))
