"""The class `Recording`: a table with one row for each sample and one named column for each signal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.errors import InputError, check_type
from drake_cafim.typing import Array

JOINT_KINDS = ("q", "v", "u", "cmd")
WRENCH_COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
POSE_COMPONENTS = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True)
class Recording:
    """One recording, SI units throughout; `recording["q.elbow"]` is a column, (N,).

    `name` is what messages call it, as given on the command line. `time` is (N,) s, strictly increasing, and need not
    be uniform. `columns` map names to (N,): `q.<joint>` (rad, m), `v.<joint>` (rad/s, m/s), `u.<joint>` (N m, N),
    `cmd.<joint>` (rad, m), `wrench.<sensor>.fx..tz` (N, N m), `pose.<body>.x..qz` (X_WB: m and a unit quaternion);
    any other is kept unchanged and not used. Arrays are read-only. NaN marks a missing measurement; samples are never
    interpolated. `notes` are sentences, one for each defect of the file and what was left out because of it.

        drake_cafim.Recording("sweep", time, {"q.elbow": q, "u.elbow": u})

    Raises `InputError` when `time` is not finite and strictly increasing, or a column has another length or no numbers.
    """

    name: str
    time: Array
    columns: Mapping[str, Array] = field(repr=False)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_type(f"{self.name}: columns", self.columns, Mapping, "arrays by name")
        time = _frozen(self.time, f"{self.name}: time")
        columns = {column: _frozen(values, f"{self.name}: column {column}") for column, values in self.columns.items()}
        if time.ndim != 1 or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0.0):
            raise InputError(f"{self.name}: time must be finite and strictly increasing, one number a sample")
        for column, values in columns.items():
            if values.shape != time.shape:
                raise InputError(
                    f"{self.name}: column {column} has shape {values.shape}, expected {time.shape} like time"
                )
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "columns", columns)

    def __len__(self) -> int:
        """The number of samples N."""
        return int(self.time.size)

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last; 0 for fewer than two."""
        return float(self.time[-1] - self.time[0]) if len(self) > 1 else 0.0

    def __getitem__(self, column: str) -> Array:
        """One column (N,); raises `InputError` with the names of all columns when there is none of this name."""
        if column not in self.columns:
            raise InputError(f"{self.name}: there is no column {column}; it has {listed(self.columns)}")
        return self.columns[column]

    def measured(self, column: str) -> Array:
        """One column (N,); raises `InputError` when there is none of this name or all its values are NaN."""
        values = self[column]
        if np.all(np.isnan(values)):
            raise InputError(f"{self.name}: column {column} holds nothing but NaN, expected measurements")
        return values

    def matrix(self, kind: str, names: Sequence[str]) -> Array:
        """The columns `<kind>.<name>` as a matrix (N, len(names)).

        `kind` is "q", "v", "u", "cmd", or a sensor's or body's whole prefix such as "wrench.wrist".
        Raises `InputError` when a column is missing or all its values are NaN.
        """
        matrix = np.empty((len(self), len(names)))
        for j, name in enumerate(names):
            matrix[:, j] = self.measured(f"{kind}.{name}")
        return matrix

    def wrench(self, sensor: str) -> Array:
        """Force and torque (N, 6): fx fy fz in N, tx ty tz in N m about the sensor frame's origin, in its axes."""
        return self.matrix(f"wrench.{sensor}", WRENCH_COMPONENTS)

    def pose(self, body: str) -> Array:
        """X_WB as (N, 7): x y z in m, then the quaternion qw qx qy qz."""
        return self.matrix(f"pose.{body}", POSE_COMPONENTS)

    def joints(self, kind: str = "q") -> tuple[str, ...]:
        """The joints that have a column of this kind, in the file's order."""
        prefix = f"{kind}."
        return tuple(column.removeprefix(prefix) for column in self.columns if column.startswith(prefix))

    @property
    def wrench_sensors(self) -> tuple[str, ...]:
        """The sensors that have at least one wrench component, in the file's order."""
        return self._places("wrench", WRENCH_COMPONENTS)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies that have at least one pose component, in the file's order."""
        return self._places("pose", POSE_COMPONENTS)

    @property
    def other_columns(self) -> tuple[str, ...]:
        """The columns whose names have no meaning in this package; the report lists them, nothing uses them."""
        return tuple(column for column in self.columns if not is_signal(column))

    def window(self, start: float, end: float) -> "Recording":
        """A recording of the samples with start <= time <= end (s), with the same notes."""
        keep = (self.time >= start) & (self.time <= end)
        columns = {column: values[keep] for column, values in self.columns.items()}
        return Recording(name=self.name, time=self.time[keep], columns=columns, notes=self.notes)

    def _places(self, kind: str, components: tuple[str, ...]) -> tuple[str, ...]:
        found = {}
        for column in self.columns:
            head, _, component = column.rpartition(".")
            if head.startswith(f"{kind}.") and component in components:
                found[head.removeprefix(f"{kind}.")] = True
        return tuple(found)


def is_signal(column: str) -> bool:
    """Whether `column` is the name of a signal of a joint, wrench sensor or body; `time` is not one."""
    kind, _, rest = column.partition(".")
    if kind in JOINT_KINDS:
        return bool(rest)
    place, _, component = rest.rpartition(".")
    components = {"wrench": WRENCH_COMPONENTS, "pose": POSE_COMPONENTS}.get(kind, ())
    return bool(place) and component in components


def _frozen(values: Array, source: str) -> Array:
    """A read-only float64 view of `values`; the caller's own array stays writable.

    Raises `InputError`, which names their `source`, for what are no real numbers.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind == "c":
            raise ValueError("complex numbers")
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"{source} holds no numbers ({error}), expected an array of them") from None
    view = array.view()
    view.flags.writeable = False
    return view


def listed(columns: Mapping[str, Array]) -> str:
    """The names of a recording's columns, for a message."""
    return ", ".join(["time", *columns])
