"""What nobody knows of a recording's beginning: how twisted soft joints were, and how far lags were behind.

Both forget it, so only the first rows see it: U (R, c) is what a standard deviation of each doubt adds to whitened
rows, whose covariance is then C = 1 + U Uᵀ, and they are multiplied by C^(−½).
"""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorLag, Effort
from drake_cafim.effects.coupling import JointCoupling
from drake_cafim.effects.timing import SensorLag
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def doubtful(physics: Physics) -> bool:
    """Whether anything remembers how it was before the first sample."""
    lags = (isinstance(one, ActuatorLag | SensorLag) for one in (*physics.actuators, *physics.sensors))
    return bool(physics.couplings) or any(lags)


@dataclass(frozen=True)
class Begun:
    """Whitened `rows` (R,) less what the beginning is to blame for, and ln det C, which that is `paid` with.

    `plain` are the rows before that, and `U` (R, c) what the doubt may change; both empty where there is none.
    """

    rows: Array
    paid: float = 0.0
    plain: Array = field(default_factory=lambda: np.zeros(0))
    U: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, rows: Array, U: Array) -> "Begun":
        """The likelier of two: in balance and settled, or not.

        A doubt that is not there would count against every joint that rings for long.
        """
        paid = float(np.sum(np.log1p(np.maximum(np.linalg.eigvalsh(U.T @ U), 0.0))))
        ringing = rows - _to_blame(U, rows)
        return cls(ringing, paid, rows, U) if ringing @ ringing + paid < rows @ rows else cls(rows)

    @property
    def start(self) -> Array:
        """What the rows say of the doubts, (c,), in prior standard deviations."""
        information = self.U.T @ self.U + np.eye(self.U.shape[1])
        return -np.asarray(np.linalg.solve(information, self.U.T @ self.plain), dtype=float)

    def without(self, columns: Array) -> Array:
        """Columns (R, k) less what the beginning is to blame for."""
        return columns - _to_blame(self.U, columns) if self.paid > 0.0 else columns


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
    """(M, r, 2) of a rotor that was twisted and turning against its link."""
    joint = physics.tree.joint_index(coupling.at)
    drive = weak.rotor_drives(physics)[joint]
    slopes = weak.samples.windows.rate @ coupling.twist_rate_by_start(drive)
    rows = np.zeros((len(slopes), weak.rows_per_window, slopes.shape[1]))
    rows[:, weak.dynamic.start + joint] = -drive.inertia * slopes / physics.effort_gains[joint]
    return rows


def _behind(weak: WeakForm, physics: Physics, lag: ActuatorLag) -> Array:
    """(M, r, 1) of an effort that was as far behind, at first, as it is on the average."""
    joint, samples = physics.tree.joint_index(lag.at), weak.samples
    asked = weak.measurement(physics).u[:, joint]
    acting = lag.drive(Effort(samples.time, asked)).means(samples.time)
    left = _decay(samples.time, lag.values["time_constant"]) * float(np.std(asked - acting))
    rows = np.zeros((len(samples.windows), weak.rows_per_window, 1))
    rows[:, weak.dynamic.start + joint, 0] = -(samples.windows.value @ left) / physics.effort_gains[joint]
    return rows


def _behind_written(weak: WeakForm, physics: Physics, lag: SensorLag) -> Array:
    """(M, r, c) of what is compared with a sensor's channels that were behind."""
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
