"""Reading and writing of comma-separated tables; semicolons and tabs are accepted when reading."""

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv

from drake_cafim.errors import InputError
from drake_cafim.recordings.columns import as_numbers, numeric_columns
from drake_cafim.recordings.limits import check_columns
from drake_cafim.recordings.recording import Recording, is_signal
from drake_cafim.typing import Array

ENCODING = "latin-1"  # decodes any bytes, so that a label in an unknown encoding does not prevent reading the numbers
NAMELESS = "nameless column "  # as after a trailing comma in every line
MISSING = ["", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "null", "NULL", "None"]


def read_csv(path: Path) -> tuple[dict[str, Array], list[str]]:
    """The numeric columns of the file by name, and a note for each column that is left out.

    The first line names the columns. A truncated last line is left out, with a note; any other line of a wrong
    length, and text in a signal's column, raise `InputError`.
    """
    names, delimiter = csv_header(path)
    cut: list[str] = []
    table = _parse(path, names, delimiter, cut)
    numeric, notes = numeric_columns(str(path), table.schema)
    numbers = {name: as_numbers(name, table[name].chunks, notes) for name in numeric}
    empty = [name for name in numbers if name.startswith(NAMELESS) and np.isnan(numbers[name]).all()]
    return {name: values for name, values in numbers.items() if name not in empty}, [*notes, *cut]


def write_csv(recording: Recording, path: Path) -> None:
    """Write the shortest decimals that read back as the same float64; a missing measurement is an empty cell."""
    arrays = {"time": recording.time, **recording.columns}
    cells = {name: pyarrow.array(np.ascontiguousarray(a), from_pandas=True) for name, a in arrays.items()}
    options = pyarrow.csv.WriteOptions(quoting_style="needed")
    pyarrow.csv.write_csv(pyarrow.table(cells), path, options)


def csv_header(path: Path) -> tuple[list[str], str]:
    """The column names and the delimiter, from the first line, without a leading # or %."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        line = file.readline().strip("\r\n")
    if not line.strip() or "\x00" in line:
        raise InputError(f"{path}: the first line is no header, expected the names of the columns")
    delimiter = next((sign for sign in (",", ";", "\t") if sign in line), ",")
    names = [name.strip().strip('"') for name in line.lstrip("#% ").split(delimiter)]
    if len(names) == 1 and names[0] != "time":
        raise InputError(
            f"{path}: the header is {names[0][:60]!r}, expected names separated by comma, semicolon or tab"
        )
    check_columns(str(path), len(names))
    names = [name or f"{NAMELESS}{j}" for j, name in enumerate(names)]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise InputError(f"{path}: column {twice[0]} occurs twice in the header, expected once")
    return names, delimiter


def _parse(path: Path, names: list[str], delimiter: str, cut: list[str]) -> pyarrow.Table:
    """The table; a truncated last line is left out and described in `cut`.

    All columns are first read as numbers, which is fast; only a file where that fails is read as text, cell by cell.
    """
    wrong: list[pyarrow.csv.InvalidRow] = []

    def collect(row: pyarrow.csv.InvalidRow) -> str:
        wrong.append(row)
        return "skip"

    try:
        return _read(path, names, pyarrow.csv.ParseOptions(delimiter=delimiter), text=False)
    except pyarrow.ArrowInvalid:
        parse = pyarrow.csv.ParseOptions(delimiter=delimiter, invalid_row_handler=collect)
        table = _numbers_where_possible(path, _read(path, names, parse, text=True))
    _check_row_lengths(path, names, wrong, cut)
    return table


def _read(path: Path, names: list[str], parse: pyarrow.csv.ParseOptions, *, text: bool) -> pyarrow.Table:
    kind = pyarrow.string() if text else pyarrow.float64()
    convert = pyarrow.csv.ConvertOptions(
        column_types=dict.fromkeys(names, kind), null_values=MISSING, strings_can_be_null=True
    )
    # With one thread, the rows that are skipped have their line numbers.
    encoding = ENCODING if text else "utf8"
    read = pyarrow.csv.ReadOptions(column_names=names, skip_rows=1, use_threads=False, encoding=encoding)
    try:
        return pyarrow.csv.read_csv(path, read_options=read, parse_options=parse, convert_options=convert)
    except pyarrow.ArrowInvalid as error:
        if not text:
            raise
        if len(path.read_text(encoding="utf-8", errors="replace").splitlines()) == 1:
            return pyarrow.table({name: pyarrow.array([], pyarrow.float64()) for name in names})
        why = str(error).splitlines()[0]
        raise InputError(f"{path}: not a table of comma-separated values ({why})") from error


def _numbers_where_possible(path: Path, table: pyarrow.Table) -> pyarrow.Table:
    """The table with each text column as numbers where all its cells are numbers; refuses a signal with other text."""
    columns = dict(zip(table.column_names, table.columns, strict=True))
    for j, name in enumerate(table.column_names):
        cells = table.column(j).to_pylist()
        bad = next((i for i, cell in enumerate(cells) if cell is not None and not _is_number(cell)), None)
        if bad is None:
            values = [np.nan if cell is None else float(cell) for cell in cells]
            columns[name] = pyarrow.chunked_array([pyarrow.array(values, pyarrow.float64())])
        elif name == "time" or is_signal(name):
            raise InputError(f"{path}: column {name} holds {cells[bad]!r} in sample {bad + 1}, expected a number")
    return pyarrow.table(columns)


def _check_row_lengths(path: Path, names: list[str], wrong: list[pyarrow.csv.InvalidRow], cut: list[str]) -> None:
    """Refuse rows of a wrong length, except a last line that is too short, as a killed writer leaves it."""
    if not wrong:
        return
    row = wrong[0]
    if len(wrong) == 1 and row.actual_columns < len(names) and _last_line(path) == row.text.strip():
        cut.append(f"the last line was cut short ({row.actual_columns} of {len(names)} cells), left out")
        return
    where = f"line {row.number}" if row.number is not None else f"the line {row.text[:40]!r}"
    raise InputError(f"{path}: {where} has {row.actual_columns} cells, expected {len(names)} as the header")


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 65536))
        lines = file.read().decode(ENCODING).strip().splitlines()
    return lines[-1].strip() if lines else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
