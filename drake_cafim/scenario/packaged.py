"""Where the packaged scenarios and models lie: in a wheel, or in a checkout, with its symbolic links or without."""

from importlib import resources
from pathlib import Path


def packaged_folder(name: str) -> Path:
    """The folder of the subpackage `diagrams` or `models`."""
    return Path(str(resources.files(f"drake_cafim.{name}")))
