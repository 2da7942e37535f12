"""Hostile recordings: small files of every format, damaged in their bytes or made of odd columns."""

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet

from drake_cafim import recordings
from drake_cafim.recordings.usable import check_usable
from tests.bags.lcm_log import write_lcm
from tests.bags.written import TOPICS, WRITERS, messages, twin
from tests.fuzzing.mutate import damage_bytes
from tests.fuzzing.verdict import judge

SAMPLES = 12
TYPES = (pyarrow.float64(), pyarrow.int64(), pyarrow.string(), pyarrow.bool_(), pyarrow.timestamp("ns"), pyarrow.null())
TYPES += (pyarrow.float16(), pyarrow.decimal128(5, 2), pyarrow.duration("ms"), pyarrow.list_(pyarrow.float64()))
TYPES += (pyarrow.uint64(), pyarrow.date32(), pyarrow.binary(), pyarrow.float32())
NAMES = (
    "time",
    "q.a",
    "v.a",
    "u.a",
    "q.",
    "wrench.w.fx",
    "pose.b.qw",
    "",
    "x",
    "q.a.b",
    "__index_level_0__",
    "é",
    "\x00",
)


class RecordingCases:
    """Inputs of all readers; each is a number, and the same number is the same input."""

    def __init__(self) -> None:
        self._seeds: list[tuple[str, dict[str, bytes]]] = []
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            given = twin(SAMPLES)
            for k, (writer, write) in enumerate(WRITERS.items()):
                (folder / str(k)).mkdir()
                self._take(write(folder / str(k), messages(given)), writer)
            self._take(write_lcm(folder / "a.lcm"), "lcm")
            for suffix in ("parquet", "csv", "mcap"):
                self._take(recordings.write(given, folder / f"a.{suffix}"), suffix)
            np.savez(folder / "a.npz", time=given.time, **given.columns)
            self._take(folder / "a.npz", "npz")
        self._contents = [content for _, files in self._seeds for content in files.values()]

    def _take(self, path: Path, writer: str) -> None:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        inside = f"{path.name}/" if path.is_dir() else ""
        self._seeds.append((writer, {f"{inside}{file.name}": file.read_bytes() for file in files}))

    def run(self, number: int, folder: Path) -> str:
        """What becomes of input `number`, written into `folder`."""
        rng = np.random.default_rng(number)
        if rng.random() < 0.2:
            path = self._made(rng, folder)
            topics: Any = None
        else:
            path, topics = self._damaged(rng, folder)

        def read() -> None:
            found = recordings.read(path, topics)
            check_usable(found, tuple(found.columns))

        return judge(read, [str(path)])

    def _damaged(self, rng: np.random.Generator, folder: Path) -> tuple[Path, Any]:
        writer, files = self._seeds[int(rng.integers(len(self._seeds)))]
        target = int(rng.integers(len(files)))
        first = None
        for k, (name, content) in enumerate(files.items()):
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(damage_bytes(content, rng, self._contents) if k == target else content)
            first = folder / name.partition("/")[0]
        assert first is not None
        return first, TOPICS if writer in WRITERS and rng.random() < 0.5 else None

    def _made(self, rng: np.random.Generator, folder: Path) -> Path:
        """A table of odd names, types and values."""
        count = int(rng.choice([0, 1, 2, 7, 8, 20]))
        names = [NAMES[i] for i in rng.integers(len(NAMES), size=int(rng.integers(1, 6)))]
        columns = [_values(rng, count) for _ in names]
        kind = str(rng.choice(["csv", "parquet", "npz"]))
        path = folder / f"made.{kind}"
        if kind == "csv":
            delimiter = str(rng.choice([",", ";", "\t", "|"]))
            rows = [names, *([str(column[i]) for column in columns] for i in range(count))]
            path.write_text("\n".join(delimiter.join(row) for row in rows), encoding="utf-8", errors="replace")
        elif kind == "npz":
            arrays = {name or "x": np.array(column) for name, column in zip(names, columns, strict=True)}
            stream = io.BytesIO()
            np.savez(stream, **{name.replace("\x00", "0"): array for name, array in arrays.items()})
            path.write_bytes(stream.getvalue())
        else:
            fields = []
            for column in columns:
                wanted = TYPES[int(rng.integers(len(TYPES)))]
                try:
                    fields.append(pyarrow.array(column).cast(wanted))
                except (pyarrow.ArrowException, TypeError, ValueError, OverflowError):
                    fields.append(pyarrow.nulls(count, wanted))
            pyarrow.parquet.write_table(pyarrow.Table.from_arrays(fields, names=names), path)
        return path


def _values(rng: np.random.Generator, count: int) -> list[Any]:
    kind = int(rng.integers(6))
    if kind == 0:
        return np.arange(count, dtype=float).tolist()
    if kind == 1:
        return (np.cumsum(rng.standard_normal(count)) * 10.0 ** rng.integers(-300, 300)).tolist()
    if kind == 2:
        return rng.choice([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, 5e-324], count).tolist()
    if kind == 3:
        return rng.integers(-(2**62), 2**62, count).tolist()
    if kind == 4:
        return np.arange(count).tolist()
    return [str(word) for word in rng.choice(["", "NA", "x", "1,5", '"', "1e3", "０", "nan"], count)]
