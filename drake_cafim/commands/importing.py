"""`cafim import`: what a foreign file holds, and the same as Parquet."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_cafim.recordings import convert


def import_command(files: Sequence[str], out: Path) -> list[dict[str, Any]]:
    """Describe each file and write it to `out` as Parquet."""
    found = []
    for name in files:
        description = convert(Path(name), out / f"{Path(name).stem}.parquet")
        found.append({"text": str(description), **description.as_dict()})
    return found
