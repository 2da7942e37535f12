"""Errors of positions that a model predicts over a second from the commands of its servos (output errors)."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.output_error.likelihood import TINY, ErrorLikelihood
from drake_cafim.diagnosis.predict.forecast import HORIZON, Forecast, simulated_courses, window_starts
from drake_cafim.diagnosis.predict.initial_state import state_at
from drake_cafim.diagnosis.predict.stepper import LONGEST_STEP
from drake_cafim.diagnosis.rows.measurement import Measurement, corrected_measurement
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import NOISE_STD_TOLERANCE
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.servos import SERVO_PARAMETERS
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices

MOST_WINDOWS = 600
"""Most windows that are simulated, spread evenly over all recordings."""
MOST_SAMPLES = 30_000
"""Most samples of all joints in these windows."""
BLOCKS = 4
"""Blocks of a recording whose errors count as independent; from as many recordings on, whole ones are left out."""
KEPT_READINGS = 2
"""Effects of sensors under which first states are kept, the latest."""
FINE_STEP, FINEST_STEP = 5e-4, 2.5e-4
"""s: steps of what is nearly as good as another, and the shortest of the last fit. Those of a search bias friction."""


def servos_with_unknowns(scene: Scene, forms: Sequence[WeakForm]) -> tuple[str, ...]:
    """The joints that a servo with an unknown parameter drives in at least one recording."""
    driven = {scene.tree.joint_names[j] for form in forms for j in form.samples.commands}
    return tuple(
        name
        for name in scene.tree.joint_names
        if name in driven and any(u.parameter in SERVO_PARAMETERS and u.at == name for u in scene.unknown)
    )


@dataclass
class OutputErrors:
    """Errors (S, c) of the simulated positions of c `joints` at all samples of the windows, rad or m.

    `windows` is their number and `block` (S,) the block of a recording that a sample is in, numbered through; in their
    `likelihood` there is one independent error in each window until they are counted.
    """

    forms: tuple[WeakForm, ...]
    joints: tuple[str, ...]
    longest_step: float = LONGEST_STEP
    """s, of the simulations."""

    def __post_init__(self) -> None:
        starts = [window_starts(form.samples.time, HORIZON) for form in self.forms]
        lengths = [HORIZON / float(np.median(np.diff(form.samples.time))) for form in self.forms]
        total = sum(map(len, starts))
        samples = sum(length * len(own) for length, own in zip(lengths, starts, strict=True)) * len(self.joints)
        every = max(1, -(-total // MOST_WINDOWS), int(np.ceil(samples / MOST_SAMPLES)))
        self._starts = [own[:: min(every, len(own))] for own in starts]
        self.windows = sum(map(len, self._starts))
        self.block = np.zeros(0, dtype=np.int64)
        self.window = np.zeros(0, dtype=np.int64)
        self.likelihood = ErrorLikelihood(np.full(len(self.joints), float(self.windows)))
        self._basis: Array | None = None
        self._states: dict[tuple[object, ...], dict[int, tuple[Array, Array, Array]]] = {}
        self._measured: dict[tuple[object, ...], Measurement] = {}

    def of(self, physics: Physics) -> Array:
        """Errors (S, c) by `physics`, without what `forgetting` takes away.

        What is no number counts as the range in which the joint moved.
        """
        found = self._simulated(physics)
        if self._basis is None:
            return found
        firsts = np.flatnonzero(np.diff(self.window, prepend=-1))
        along = np.add.reduceat(self._basis * found[..., None], firsts, axis=0)
        return np.asarray(found - np.sum(self._basis * along[self.window], axis=-1), dtype=float)

    def forgetting(self, physics: Physics) -> None:
        """From now on, errors are without what two components of each window's first state can explain.

        Of each joint these are the columns of a root of the covariance of its q and v there, simulated with `physics`.
        The first state is read from a few samples, and a joint that sticks never forgets its error.
        """
        found = self._simulated(physics)
        by_state = np.stack([self._simulated(physics, column) - found for column in (0, 1)], axis=-1)
        for w in range(self.windows):
            own = self.window == w
            for j in range(len(self.joints)):
                Q = np.linalg.qr(by_state[own, j])[0]
                by_state[own, j] = 0.0
                by_state[own, j, : Q.shape[1]] = Q
        self._basis = by_state

    def finely(self) -> "OutputErrors":
        """The same errors, simulated in fine steps and counted apart."""
        fine = copy(self)
        fine.longest_step = FINE_STEP
        return fine

    def most_finely(self, physics: Physics) -> "OutputErrors":
        """The same errors in steps so fine that half of them would change −2 ln p by less than one."""
        fine = self.finely()
        found = fine.of(physics)
        fine.count(found)
        while fine.longest_step > FINEST_STEP:
            half = copy(fine)
            half.longest_step = 0.5 * fine.longest_step
            after = half.of(physics)
            change, weight = np.sum((after - found) ** 2, axis=0), fine.likelihood.weight
            if all(weight(found[:, j], j) * change[j] < 1.0 for j in range(len(self.joints))):
                break
            fine, found = half, after
            fine.count(found)
        return fine

    def count(self, found: Array) -> None:
        """The likelihood is that of errors as independent as `found` (S, c) from now on."""
        self.likelihood = ErrorLikelihood.of(found, self.window)

    def _simulated(self, physics: Physics, doubt: int | None = None) -> Array:
        """Errors (S, c), with the first states off by a column `doubt` of a root of their covariance."""
        chosen = {id(form): own for form, own in zip(self.forms, self._starts, strict=True)}
        # what sensors of velocities do matters to the first states alone
        own = replace(physics, sensors=tuple(e for e in physics.sensors if not e.at.startswith("v.")))
        # a trial may diverge
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = simulated_courses(
                self.forms,
                own,
                lambda weak: (chosen[id(weak)], HORIZON),
                lambda weak, _, start: self._first_state(weak, physics, start, doubt),
                self.longest_step,
            )
        if not len(self.block):
            self.block = np.concatenate([_blocks(k, forecast) for k, forecast in enumerate(found)])
            firsts = np.cumsum([0, *(len(own) for own in self._starts)])
            self.window = np.concatenate([f.window + first for f, first in zip(found, firsts, strict=False)])
        return np.concatenate([self._misses(forecast) for forecast in found])

    def mean_squares(self, found: Array) -> Array:
        """(c,) mean of the squared errors of each joint, rad² (m²)."""
        return np.asarray(np.maximum(np.mean(found**2, axis=0), TINY), dtype=float)

    def p_values(self, found: Array) -> Array:
        """(c,) probability that noise of the encoders alone makes errors as large as `found` (S, c).

        Σ e²/σ² is χ² with as many degrees of freedom as there are samples, two less in each window where its first
        state is forgotten. σ may be understated by `NOISE_STD_TOLERANCE`.
        """
        freedom = len(found) - (0 if self._basis is None else 2 * self.windows)
        std = np.array([self.forms[0].samples.std[f"q.{name}"] for name in self.joints])
        allowed = np.maximum((1.0 + NOISE_STD_TOLERANCE) * std, np.sqrt(TINY))
        return np.asarray(chi2.sf(np.sum((found / allowed) ** 2, axis=0), freedom), dtype=float)

    def _first_state(self, weak: WeakForm, physics: Physics, start: int, doubt: int | None) -> tuple[Array, Array]:
        """q and v (n,) at the start of a window, the same for every model with the same effects of sensors."""
        sensors = tuple((effect.key, *effect.values.values()) for effect in physics.sensors)
        key = (id(weak), *sensors)
        if key not in self._states:
            make_room(self._states, KEPT_READINGS * len(self.forms))
            self._states[key] = {}
        if start not in self._states[key]:
            if key not in self._measured:
                make_room(self._measured, KEPT_READINGS * len(self.forms))
                self._measured[key] = corrected_measurement(weak.samples, weak.sensors, physics)
            self._states[key][start] = state_at(weak.samples, self._measured[key], start)
        q, v, covariance = self._states[key][start]
        if doubt is None:
            return q, v
        root = np.linalg.cholesky(covariance + 1e-18 * np.eye(2))
        return q + root[:, 0, doubt], v + root[:, 1, doubt]

    def _misses(self, forecast: Forecast) -> Array:
        columns = []
        for name in self.joints:
            measured = forecast.measured[f"q.{name}"]
            miss = forecast.predicted[f"q.{name}"] - measured
            if not np.any(np.isfinite(measured)):
                columns.append(np.zeros(len(measured)))
                continue
            lost = np.where(np.isfinite(miss), miss, np.nanmax(measured) - np.nanmin(measured))
            # a sample that is missing says nothing
            columns.append(np.where(np.isfinite(measured), lost, 0.0))
        return np.stack(columns, axis=1)


def left_out_parts(block: Indices) -> Indices:
    """(S,) which part each of the samples in these blocks (S,) is left out with: its recording, or one of few's blocks.

    What happens at the same place of every turn of a periodic motion is in all blocks of that recording.
    """
    recording = block // BLOCKS
    return recording if len(np.unique(recording)) >= BLOCKS else block


def _blocks(recording: int, forecast: Forecast) -> Indices:
    windows = np.unique(forecast.window)
    at = np.searchsorted(windows, forecast.window)
    return np.asarray(BLOCKS * recording + at * BLOCKS // len(windows), dtype=np.int64)
