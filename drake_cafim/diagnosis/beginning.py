"""What nobody knows of a recording's beginning: how twisted soft joints were, and how far lags were behind.

Both forget it, so only the first rows see it: U (R, c) is what each doubt adds to whitened rows where it is as large
as could be, their covariance is then C = 1 + U W² Uᵀ, and they are multiplied by C^(−½). The widths W, from 0 to 1,
are the likeliest ones (type-II maximum likelihood; MacKay, Neural Computation 4(3), 1992): a start that is a little
off is paid for as far as it is off, and one in balance costs nothing. With doubts as wide as could be, a stiffness
under which nothing rings, and which pays for no doubt, would pass for likelier than the one that is there.
"""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.compiled import compiled
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.windows import Windows
from drake_cafim.effects.actuator import ActuatorLag
from drake_cafim.effects.coupling import JointBacklash, JointCoupling, RotorDrive
from drake_cafim.effects.timing import SensorLag
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

TURNS, SETTLED = 60, 1e-8
"""Turns at the variances at most, and the part of one that ends them."""
LAGS_KEPT = 8
"""Of what a sensor's lag leaves in doubt."""
UNSETTLED, FORGOTTEN = 12, 0.01
"""Windows at most that a start in a gap shows in, and the part of it below which it is forgotten."""
FAINT = 1e-4
"""Of a squared whitened row: what a doubt must change the rows by, all together, to be one."""


def doubtful(physics: Physics) -> bool:
    """Whether anything remembers how it was before the first sample."""
    lags = (isinstance(one, ActuatorLag | SensorLag) for one in (*physics.actuators, *physics.sensors))
    return bool(physics.couplings) or any(lags)


@dataclass(frozen=True)
class Begun:
    """Whitened `rows` (R,) less what the beginning is to blame for, and ln det C, which that is `paid` with.

    `plain` are the rows before that, `U` (R, c) what the doubts may change at their `widths` (c,); the first
    two are empty where there is none.
    """

    rows: Array
    paid: float = 0.0
    plain: Array = field(default_factory=lambda: np.zeros(0))
    U: Array = field(default_factory=lambda: np.zeros((0, 0)))
    widths: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, rows: Array, U: Array, widths: Array | None = None) -> "Begun":
        """With each doubt as wide as is likeliest, or as `widths` say; settled, where that is no doubt at all."""
        if widths is None or len(widths) != U.shape[1]:
            widths = likeliest_widths(U.T @ U, U.T @ rows)
        if not np.any(widths):
            return cls(rows, widths=widths)
        U = U * widths
        return cls(rows - _to_blame(U, rows), _log_determinant(U.T @ U), rows, U, widths)

    @property
    def start(self) -> Array:
        """What the rows say of the doubts, (c,), in what each is at most."""
        information = self.U.T @ self.U + np.eye(self.U.shape[1])
        return np.asarray(-self.widths * np.linalg.solve(information, self.U.T @ self.plain), dtype=float)

    def without(self, columns: Array) -> Array:
        """Columns (R, k) less what the beginning is to blame for."""
        return columns - _to_blame(self.U, columns) if self.paid > 0.0 else columns


def likeliest_widths(gram: Array, seen: Array) -> Array:
    """The widths (c,) from 0 to 1 under which rows z are likeliest, of `gram` UᵀU (c, c) and `seen` Uᵀz (c,).

    From no doubt and from every doubt as large as could be, whichever leads to the likelier.
    """
    gram, seen = np.ascontiguousarray(gram), np.ascontiguousarray(seen)
    found = [_climbed(gram, seen, start) for start in (np.zeros(len(seen)), np.ones(len(seen)))]
    return np.asarray(np.sqrt(min(found, key=lambda variances: _cost(gram, seen, variances))))


@compiled
def _climbed(gram: Array, seen: Array, variances: Array) -> Array:
    """Each variance in its turn where the likelihood is largest in it (Tipping, Faul, AISTATS 2003)."""
    for _ in range(TURNS):
        before = variances.copy()
        for i in range(len(seen)):
            others = np.sqrt(variances)
            others[i] = 0.0
            left, answer = _beside(gram, seen, others, i)
            wanted = (answer**2 - left) / left**2 if left > FAINT else 0.0
            variances[i] = min(max(wanted, 0.0), 1.0)
        if np.all(np.abs(variances - before) <= SETTLED * variances):
            break
    return variances


@compiled
def _beside(gram: Array, seen: Array, widths: Array, i: int) -> tuple[float, float]:
    """uᵀC⁻¹u and uᵀC⁻¹z of doubt `i` under the covariance of the others, of `widths` (c,)."""
    C = np.eye(len(seen)) + np.expand_dims(widths, 1) * gram * widths
    shared = widths * gram[:, i]
    left, answer = gram[i, i], seen[i]
    # C holds what is there for certain beside what may be: elimination needs no pivots
    for c in range(len(seen)):
        for r in range(c + 1, len(seen)):
            C[r, c] /= C[c, c]
            for k in range(c + 1, len(seen)):
                C[r, k] -= C[r, c] * C[c, k]
            shared[r] -= C[r, c] * shared[c]
    for c in range(len(seen) - 1, -1, -1):
        for k in range(c + 1, len(seen)):
            shared[c] -= C[c, k] * shared[k]
        shared[c] /= C[c, c]
        left -= widths[c] * gram[c, i] * shared[c]
        answer -= widths[c] * seen[c] * shared[c]
    return left, answer


def _cost(gram: Array, seen: Array, variances: Array) -> float:
    """zᵀC⁻¹z + ln det C, less zᵀz."""
    widths = np.sqrt(variances)
    scaled, answer = widths[:, None] * gram * widths, widths * seen
    return _log_determinant(scaled) - float(answer @ np.linalg.solve(np.eye(len(seen)) + scaled, answer))


def _log_determinant(gram: Array) -> float:
    return float(np.sum(np.log1p(np.maximum(np.linalg.eigvalsh(gram), 0.0))))


def _to_blame(U: Array, rows: Array) -> Array:
    """What C^(−½) takes off rows (R, ...)."""
    spread, axes = np.linalg.eigh(U.T @ U)
    spread = np.maximum(spread, 1e-12)
    shrink = (1.0 - 1.0 / np.sqrt(1.0 + spread)) / spread
    return np.asarray(U @ ((axes * shrink) @ (axes.T @ (U.T @ rows))), dtype=float)


def start_rows(weak: WeakForm, physics: Physics) -> Array:
    """Rows (M, r, c) of the doubts, in prior standard deviations: two a coupling first, then those of lags."""
    parts = [_twisted(weak, physics, coupling) for coupling in physics.couplings]
    parts += [_behind(weak, physics, lag) for lag in physics.actuators if isinstance(lag, ActuatorLag)]
    parts += [_behind_written(weak, physics, lag) for lag in physics.sensors if isinstance(lag, SensorLag)]
    return np.concatenate(parts, axis=2)


def _twisted(weak: WeakForm, physics: Physics, coupling: JointCoupling) -> Array:
    """(M, r, c) of a rotor that was twisted and turning against its link."""
    joint = physics.tree.joint_index(coupling.at)
    drive, windows = weak.rotor_drives(physics)[joint], weak.samples.windows
    slopes = windows.rate @ coupling.twist_rate_by_start(drive)
    if isinstance(coupling, JointBacklash):
        slopes = np.concatenate([slopes, unsettled(coupling, drive, windows)], axis=1)
    rows = np.zeros((len(slopes), weak.rows_per_window, slopes.shape[1]))
    rows[:, weak.dynamic.start + joint] = -drive.inertia * slopes / physics.effort_gains[joint]
    return rows


def unsettled(coupling: JointBacklash, drive: RotorDrive, windows: Windows) -> Array:
    """(M, c) of a rotor that began anywhere in its gap, until where it began is forgotten: whatever a window may show.

    An impact that comes at another time is no sum of small changes.
    """
    default = coupling.twist_rate(drive)
    change = np.max(np.abs(windows.rate @ (coupling.twist_rates_from(drive) - default[:, None])), axis=1)
    known = min(UNSETTLED, len(change))
    largest = float(np.max(change[:known]))
    last = int(np.flatnonzero(change[:known] > FORGOTTEN * largest)[-1]) if largest > 0.0 else -1
    found = np.zeros((len(change), known))
    found[range(last + 1), range(last + 1)] = largest
    return found


def _behind(weak: WeakForm, physics: Physics, lag: ActuatorLag) -> Array:
    """(M, r, 1) of an effort that was as far behind, at first, as it is on the average."""
    joint, samples = physics.tree.joint_index(lag.at), weak.samples
    left = _decay(samples.time, lag.values["time_constant"]) * weak.std_behind(physics, lag)
    rows = np.zeros((len(samples.windows), weak.rows_per_window, 1))
    rows[:, weak.dynamic.start + joint, 0] = -(samples.windows.value @ left) / physics.effort_gains[joint]
    return rows


def _behind_written(weak: WeakForm, physics: Physics, lag: SensorLag) -> Array:
    """(M, r, c) of what is compared with a sensor's channels that were behind; kept with what they were read as."""
    known, key = weak.in_doubt(physics), (lag.at, lag.values["time_constant"])
    if key not in known:
        make_room(known, LAGS_KEPT)
        known[key] = _reckoned_behind(weak, physics, lag)
    return known[key]


def _reckoned_behind(weak: WeakForm, physics: Physics, lag: SensorLag) -> Array:
    windows, time, measured = weak.samples.windows, weak.samples.time, weak.measurement(physics)
    left = _decay(time, lag.values["time_constant"])
    kind, _, joint = lag.at.partition(".")
    if kind in ("q", "v"):
        rows = np.zeros((len(windows), weak.rows_per_window, 1))
        if weak.kinematic_rows:
            j = physics.tree.joint_index(joint)
            partner, slopes = (measured.v, windows.value) if kind == "q" else (measured.q, windows.rate)
            behind = float(np.std(partner[:, j] - lag.measured(time, partner[:, j : j + 1])[:, 0]))
            rows[:, j, 0] = (slopes @ (lag.facing(time) @ left)) * behind * weak.louder(physics)[:, j]
        return rows
    names = [f"wrench.{sensor.name}.{axis}" for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    on = [names.index(name) for name in lag.channels(names)]
    written = np.concatenate(measured.wrenches, axis=1)[:, on]
    behind = np.std(written - lag.measured(time, written), axis=0)
    rows = np.zeros((len(windows), weak.rows_per_window, len(on)))
    rows[:, [weak.dynamic.stop + k for k in on], range(len(on))] = (windows.value @ left)[:, None] * behind
    return rows


def _decay(time: Array, time_constant: float) -> Array:
    """(N,) what is left of how far a lag was behind at the first sample."""
    since = time - time[0]
    return np.exp(-since / time_constant) if time_constant > 0.0 else np.zeros_like(since)
