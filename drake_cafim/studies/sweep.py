"""Carries out the runs of a study in parallel and stores each in a file, so that an interrupted study can continue."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.studies.cell import Cell, measure


def sweep(cells: Sequence[Cell], folder: Path, jobs: int, progress: Callable[[str], None]) -> dict[Cell, Any]:
    """The result of `measure` for each cell; a cell whose file is in `folder` already is read instead of run."""
    unique = list(dict.fromkeys(cells))
    waiting = [cell for cell in unique if not _file(folder, cell).is_file()]
    done = len(unique) - len(waiting)
    progress(f"{done} of {len(unique)} runs")
    work = Parallel(n_jobs=jobs, return_as="generator_unordered")(delayed(_keep)(cell, folder) for cell in waiting)
    for _ in work:
        done += 1
        progress(f"{done} of {len(unique)} runs")
    return {cell: _kept(_file(folder, cell)) for cell in unique}


def limit_seeds(cells: Sequence[Cell], seeds: int) -> list[Cell]:
    """The cells with at most `seeds` of each group that differs in the seed alone, the first ones."""
    groups: dict[Cell, list[Cell]] = {}
    for cell in dict.fromkeys(cells):
        groups.setdefault(replace(cell, seed=0), []).append(cell)
    return [cell for group in groups.values() for cell in group[:seeds]]


def _file(folder: Path, cell: Cell) -> Path:
    return folder / f"{cell.key}.json"


def _kept(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        raise InputError(
            f"{file}: it is no result of a run; delete it, and give the command again with --resume"
        ) from None


def _keep(cell: Cell, folder: Path) -> None:
    write_text(_file(folder, cell), json.dumps(measure(cell), ensure_ascii=False))
