"""Tables of learned forces: Parquet files with the columns `variables`, `x`, `force` and `width`."""

import os
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drake_cafim.effects.learned_force import MEMORY, SIDED, TERMS, LearnedForce, Term
from drake_cafim.errors import InputError
from drake_cafim.output import replacing

COLUMNS = ("variables", "x", "force", "width")


def write_law(path: Path, columns: Mapping[str, Sequence[float | str]]) -> None:
    """Writes the `law_table` of a learned force."""
    table = pa.table({name: list(values) for name, values in columns.items()})
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def read_law(at: str, path: Path, table: str, key: str) -> LearnedForce:
    """The learned force at the joint `at` from the file at `path`, which the scenario calls `table`.

    `key` names the scenario's entry. Raises `InputError` for a file that is missing, is no such table, or has other
    than increasing finite places and finite forces.
    """
    if not os.path.isfile(path):
        raise InputError(f"{key}.table is {table}: there is no file {path}")
    try:
        columns = pq.read_table(path).to_pydict()
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(f"{key}.table: {path} is no Parquet file ({error})") from None
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        found = ", ".join(columns) or "none"
        raise InputError(f"{key}.table: {path} lacks the columns {', '.join(missing)}; found: {found}")
    terms = []
    for variables, group in groupby(zip(*(columns[name] for name in COLUMNS), strict=True), key=lambda row: row[0]):
        rows = list(group)
        if variables not in TERMS:
            raise InputError(f"{key}.table: {path}: variables are {variables!r}, expected one of {', '.join(TERMS)}")
        try:
            numbers = np.array([row[1:] for row in rows], dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"{key}.table: {path}: not all of x, force, width of {variables} are numbers") from None
        if not np.all(np.isfinite(numbers)) or not np.all(np.diff(numbers[:, 0]) > 0.0):
            raise InputError(f"{key}.table: {path}: x of {variables} must increase, and all numbers be finite")
        width = float(numbers[0, 2])
        if variables in (SIDED, MEMORY) and not width > 0.0:
            raise InputError(f"{key}.table: {path}: the width of {variables} is {width:g}, expected above 0")
        if variables == MEMORY and not (len(numbers) == 1 and numbers[0, 0] > 0.0):
            raise InputError(
                f"{key}.table: {path}: x of {variables} is {numbers[:, 0].tolist()}, expected one number above 0"
            )
        if variables == MEMORY and numbers[0, 1] > 0.0:
            raise InputError(f"{key}.table: {path}: the force of {variables} is {numbers[0, 1]:g}, expected at most 0")
        terms.append(Term(variables, tuple(map(float, numbers[:, 0])), tuple(map(float, numbers[:, 1])), width))
    if not terms:
        raise InputError(f"{key}.table: {path} has no rows")
    return LearnedForce(at, {}, tuple(terms), table)
