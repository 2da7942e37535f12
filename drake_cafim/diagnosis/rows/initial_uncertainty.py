"""The unknown initial state of a recording: the twist of soft joints, and the deviation of lags; marginalised.

Its effect decays, so it enters the first rows alone. Column i of U (R, c) is the change of the whitened rows by one
prior standard deviation of initial value i; the rows' covariance is then C = 1 + U W² Uᵀ, and they are multiplied by
C^(−½). The relative widths W (diagonal, from 0 to 1) maximise the marginal likelihood (type-II maximum likelihood;
MacKay, Neural Computation 4(3), 1992): an initial state in balance then costs nothing, and a small deviation little.
With W = 1, a stiffness under which nothing rings, and which has no Occam factor ln det C to pay, could be more likely
than the true one.
"""

from dataclasses import dataclass, field
from typing import cast

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import INITIAL_DOUBT_ROW_CHANGE
from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.compiled import compiled
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

MOST_SWEEPS, TOLERANCE = 60, 1e-8
"""Most sweeps of the coordinate ascent over the variances, and the relative change at which it has converged."""
CACHED_LAGS = 8
"""Most cached rows of sensors' lags."""
MOST_WINDOWS, DECAYED_SHARE = 12, 0.01
"""Most windows that the initial position in a gap may change; the fraction of its largest change that counts as 0."""


def has_unknown_start(physics: Physics) -> bool:
    """Whether `physics` has states whose initial values are unknown: couplings, or lags with a settling time."""
    lags = (effect.settling is not None for effect in (*physics.actuators, *physics.sensors))
    return bool(physics.couplings) or any(lags)


@dataclass(frozen=True)
class StartMarginal:
    """The residual with the unknown initial state marginalised: `rows` C^(−½) z (R,), and `paid`, ln det C.

    `plain` are the whitened rows z before that, `U` (R, c) their change by each initial value times its `widths` (c,);
    `plain` and `U` are empty where there is no unknown initial state.
    """

    rows: Array
    paid: float = 0.0
    plain: Array = field(default_factory=lambda: np.zeros(0))
    U: Array = field(default_factory=lambda: np.zeros((0, 0)))
    widths: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, rows: Array, U: Array, widths: Array | None = None) -> "StartMarginal":
        """The marginal of whitened `rows` (R,), with the most likely widths unless `widths` (c,) are given."""
        if widths is None or len(widths) != U.shape[1]:
            widths = likeliest_widths(U.T @ U, U.T @ rows)
        if not np.any(widths):
            return cls(rows, widths=widths)
        U = U * widths
        return cls(rows - _correction(U, rows), _log_determinant(U.T @ U), rows, U, widths)

    @property
    def start(self) -> Array:
        """Posterior means (c,) of the initial values, in prior standard deviations."""
        information = self.U.T @ self.U + np.eye(self.U.shape[1])
        return np.asarray(-self.widths * np.linalg.solve(information, self.U.T @ self.plain), dtype=float)

    def without(self, columns: Array) -> Array:
        """`columns` (R, k) multiplied by C^(−½), as the rows are."""
        return columns - _correction(self.U, columns) if self.paid > 0.0 else columns


def likeliest_widths(gram: Array, seen: Array) -> Array:
    """Widths (c,) from 0 to 1 that maximise the marginal likelihood of rows z; `gram` UᵀU (c, c), `seen` Uᵀz (c,).

    The better of two local maxima, reached from all widths 0 and from all widths 1.
    """
    gram, seen = np.ascontiguousarray(gram), np.ascontiguousarray(seen)
    found = [_maximise(gram, seen, start) for start in (np.zeros(len(seen)), np.ones(len(seen)))]
    return np.asarray(np.sqrt(min(found, key=lambda variances: _cost(gram, seen, variances))))


@compiled
def _maximise(gram: Array, seen: Array, variances: Array) -> Array:
    """Variances (c,) by coordinate ascent of the marginal likelihood (Tipping, Faul, AISTATS 2003)."""
    for _ in range(MOST_SWEEPS):
        before = variances.copy()
        for i in range(len(seen)):
            others = np.sqrt(variances)
            others[i] = 0.0
            left, answer = _project(gram, seen, others, i)
            wanted = (answer**2 - left) / left**2 if left > INITIAL_DOUBT_ROW_CHANGE else 0.0
            variances[i] = min(max(wanted, 0.0), 1.0)
        if np.all(np.abs(variances - before) <= TOLERANCE * variances):
            break
    return variances


@compiled
def _project(gram: Array, seen: Array, widths: Array, i: int) -> tuple[float, float]:
    """uᵀC⁻¹u and uᵀC⁻¹z for column u = `i` of U, under the covariance C of the other columns with `widths` (c,)."""
    C = np.eye(len(seen)) + np.expand_dims(widths, 1) * gram * widths
    shared = widths * gram[:, i]
    left, answer = gram[i, i], seen[i]
    # C = 1 + a positive semidefinite matrix: elimination needs no pivots
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
    """Twice the negative log marginal likelihood up to a constant: zᵀC⁻¹z + ln det C − zᵀz."""
    widths = np.sqrt(variances)
    scaled, answer = widths[:, None] * gram * widths, widths * seen
    return _log_determinant(scaled) - float(answer @ np.linalg.solve(np.eye(len(seen)) + scaled, answer))


def _log_determinant(gram: Array) -> float:
    """ln det (1 + `gram`)."""
    return float(np.sum(np.log1p(np.maximum(np.linalg.eigvalsh(gram), 0.0))))


def _correction(U: Array, rows: Array) -> Array:
    """(1 − C^(−½)) `rows` (R, ...) for C = 1 + U Uᵀ."""
    spread, axes = np.linalg.eigh(U.T @ U)
    spread = np.maximum(spread, 1e-12)
    shrink = (1.0 - 1.0 / np.sqrt(1.0 + spread)) / spread
    return np.asarray(U @ ((axes * shrink) @ (axes.T @ (U.T @ rows))), dtype=float)


def start_rows(weak: WeakForm, physics: Physics) -> Array:
    """Rows' changes (M, r, c) by one prior standard deviation of each initial value: couplings first, then lags."""
    parts = [_coupling_rows(weak, physics, coupling) for coupling in physics.couplings]
    parts += [_effort_lag_rows(weak, physics, lag) for lag in physics.actuators if lag.settling is not None]
    parts += [_sensor_lag_rows(weak, physics, lag) for lag in physics.sensors if lag.settling is not None]
    return np.concatenate(parts, axis=2)


def _coupling_rows(weak: WeakForm, physics: Physics, coupling: JointCoupling) -> Array:
    """(M, r, c) rows by the initial twist and twist rate between a rotor and its link (and its place in a gap)."""
    joint = physics.tree.joint_index(coupling.at)
    drive, windows = weak.couplings.rotor_drives(physics)[joint], weak.samples.windows
    slopes = windows.rate @ coupling.twist_rate_by_start(drive)
    if coupling.impacts:
        slopes = np.concatenate([slopes, gap_start_rows(coupling, drive, windows)], axis=1)
    rows = np.zeros((len(slopes), weak.rows_per_window, slopes.shape[1]))
    rows[:, weak.dynamic.start + joint] = -drive.inertia * slopes / physics.effort_gains[joint]
    return rows


def gap_start_rows(coupling: JointCoupling, drive: RotorDrive, windows: Windows) -> Array:
    """(M, c) largest changes of ∫ ẇ ψ̇ dt by a rotor's unknown initial position in its gap; one free column a window.

    Windows are free until the initial position has no effect any more. An impact at another time is not linear in the
    initial position, so that no fixed columns could describe it.
    """
    default = coupling.twist_rate(drive)
    change = np.max(np.abs(windows.rate @ (coupling.twist_rates_from(drive) - default[:, None])), axis=1)
    known = min(MOST_WINDOWS, len(change))
    largest = float(np.max(change[:known]))
    last = int(np.flatnonzero(change[:known] > DECAYED_SHARE * largest)[-1]) if largest > 0.0 else -1
    found = np.zeros((len(change), known))
    found[range(last + 1), range(last + 1)] = largest
    return found


def _effort_lag_rows(weak: WeakForm, physics: Physics, lag: ActuatorEffect) -> Array:
    """(M, r, 1) rows by an effort's initial deviation from the command, of the size that it has on average."""
    joint, samples = physics.tree.joint_index(lag.at), weak.samples
    left = _decay(samples.time, lag.settling) * weak.terms(physics).driven.std_behind(physics, lag)
    rows = np.zeros((len(samples.windows), weak.rows_per_window, 1))
    rows[:, weak.dynamic.start + joint, 0] = -(samples.windows.value @ left) / physics.effort_gains[joint]
    return rows


def _sensor_lag_rows(weak: WeakForm, physics: Physics, lag: SensorEffect) -> Array:
    """(M, r, c) rows by the initial deviation of a lagging sensor's channels; cached with the measurement."""
    known, key = weak.terms(physics).in_doubt, (lag.at, lag.settling or 0.0)
    if key not in known:
        make_room(known, CACHED_LAGS)
        known[key] = _compute_sensor_lag_rows(weak, physics, lag)
    return known[key]


def _compute_sensor_lag_rows(weak: WeakForm, physics: Physics, lag: SensorEffect) -> Array:
    """`_sensor_lag_rows` without the cache."""
    windows, time, measured = weak.samples.windows, weak.samples.time, weak.measurement(physics)
    left = _decay(time, lag.settling)
    kind, _, joint = lag.at.partition(".")
    if kind in ("q", "v"):
        rows = np.zeros((len(windows), weak.rows_per_window, 1))
        if weak.kinematic_rows:
            j = physics.tree.joint_index(joint)
            partner, slopes = (measured.v, windows.velocity) if kind == "q" else (measured.q, windows.rate)
            behind = float(np.std(partner[:, j] - lag.measured(time, partner[:, j : j + 1])[:, 0]))
            facing = cast(sp.csr_matrix, lag.kinematic_correction(time))  # an effect with a settling time has one
            rows[:, j, 0] = (slopes @ (facing @ left)) * behind * weak.terms(physics).louder[:, j]
        return rows
    names = [f"wrench.{sensor.name}.{axis}" for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    on = [names.index(name) for name in lag.channels(names)]
    written = np.concatenate(measured.wrenches, axis=1)[:, on]
    behind = np.std(written - lag.measured(time, written), axis=0)
    rows = np.zeros((len(windows), weak.rows_per_window, len(on)))
    rows[:, [weak.dynamic.stop + k for k in on], range(len(on))] = (windows.value @ left)[:, None] * behind
    return rows


def _decay(time: Array, time_constant: float | None) -> Array:
    """(N,) the fraction e^(−(t − t₀)/τ) of a lag's initial deviation that remains; 0 without a time constant."""
    since = time - time[0]
    return np.exp(-since / time_constant) if time_constant else np.zeros_like(since)
