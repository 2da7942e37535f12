"""`cafim import`: describes the contents of bags, logs and tables, and converts them to Parquet."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.recordings import convert
from drake_cafim.recordings.files import check_path
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve


def import_command(
    files: Sequence[str], out: Path, *, scenario: str | None = None, period: float | None = None
) -> list[dict[str, Any]]:
    """Describe each file and write it to `out` as Parquet.

    Names are mapped by `topics:` of the scenario file; samples stay where they are unless a `period` (s) is asked for.
    """
    topics = load(resolve(scenario)).topics if scenario else {}
    # a folder may be named by a dot alone
    targets = [out / f"{Path(os.path.abspath(name)).stem}.parquet" for name in files]
    for name, target in zip(files, targets, strict=True):
        if targets.count(target) > 1:
            raise InputError(f"{name}: another file would be written as {target.name} too; import them one by one")
    for name in files:
        check_path(Path(name))
    found = []
    for name, target in zip(files, targets, strict=True):
        description = convert(Path(name), target, topics, period=period)
        found.append({"text": str(description), **description.as_dict()})
    return found
