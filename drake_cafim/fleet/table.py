"""The fleet's table: a row for each strength of each recording, and one for a recording or folder without any."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from drake_cafim.fleet.layout import Folder
from drake_cafim.fleet.summary import Measured, Summary
from drake_cafim.output import replacing

FAILED = "failed"
"""The verdict of a folder that could not be diagnosed."""
SCHEMA = pa.schema(
    [
        ("robot", pa.string()),
        ("recording", pa.string()),
        ("time", pa.timestamp("s", tz="UTC")),
        ("effect", pa.string()),
        ("place", pa.string()),
        ("strength", pa.float64()),
        ("std", pa.float64()),
        ("probability", pa.float64()),
        ("verdict", pa.string()),
        ("parameter", pa.string()),
        ("unit", pa.string()),
        ("kind", pa.string()),
        ("folder", pa.string()),
        ("why", pa.string()),
    ]
)
"""`recording` is its path below the robot's folder; `parameter` and `unit` are the strength's; `probability` is that by
which the folder's diagnosis named the effect, null where it did not; `why` says why there is no strength."""
Row = dict[str, Any]


def rows_of(folder: Folder, summary: Summary, measured: Sequence[Measured]) -> list[Row]:
    """The rows of one folder."""
    own: Row = {"robot": folder.robot, "folder": folder.name, "kind": summary.kind or None}
    if summary.failure:
        return [own | {"recording": _below(folder), "time": folder.when(), "verdict": FAILED, "why": summary.failure}]
    rows = []
    times = {item.recording: item.time for item in measured}
    strengths = {item.recording: item for item in measured}
    for recording in folder.recordings:
        base = own | {
            "recording": _below(folder, recording),
            "time": times.get(recording) or folder.when(recording),
            "verdict": summary.verdict,
        }
        found = _strengths(summary, strengths.get(recording))
        rows += [base | item for item in found] or [base]
    return rows


def _strengths(summary: Summary, measured: Measured | None) -> list[Row]:
    """Of one recording: the strengths that were fitted in it, and what was named but could not be."""
    probability = {named.key: named.probability for named in summary.named}
    rows: list[Row] = []
    for item in measured.strengths if measured else ():
        key = (item.effect, item.at)
        rows.append(
            {"effect": item.effect, "place": item.at, "parameter": item.parameter, "unit": item.unit,
             "strength": item.value, "std": item.std, "probability": probability.get(key)}
        )  # fmt: skip
    fitted = {(row["effect"], row["place"]) for row in rows}
    for named in summary.named:
        if named.key in fitted:
            continue
        why = measured.failure if measured and measured.failure else "the strength in all of the folder's recordings"
        for name, value in named.parameters.items():
            if isinstance(value["value"], str):  # a choice, such as that of a law, has no strength
                continue
            rows.append(
                {"effect": named.effect, "place": named.at, "parameter": name, "unit": value["unit"],
                 "strength": value["value"], "std": value["std"], "probability": named.probability, "why": why}
            )  # fmt: skip
    return rows


def _below(folder: Folder, recording: str = "") -> str:
    """The path of a recording, or of the folder itself, below the robot's folder."""
    return "/".join([*folder.name.split("/")[1:], *([recording] if recording else [])])


def write_table(path: Path, rows: Iterable[Row]) -> None:
    """Write the rows as Parquet, sorted, so that the same rows give the same bytes in whatever order they came."""
    ordered = sorted(rows, key=_order)
    columns = {name: [row.get(name) for row in ordered] for name in SCHEMA.names}
    with replacing(path) as temporary:
        pq.write_table(pa.Table.from_pydict(columns, schema=SCHEMA), temporary)


def read_table(path: Path) -> list[Row]:
    """The rows of a table, as `write_table` wrote them."""
    rows: list[Row] = pq.read_table(path).to_pylist()
    return rows


def _order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    time: datetime | None = row.get("time")
    last = (time is None, time.isoformat() if time else "")
    return (row["robot"], *last, *(row.get(name) or "" for name in ("recording", "effect", "place", "parameter")))
