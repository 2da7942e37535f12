"""The estimate of highest likelihood of whole recordings, by multiple shooting from every sample.

The trajectories and the parameters are found together: Gauss–Newton steps about trajectories that begin as the recorded
ones, whose steps need not join, so that neither an unstable motion nor one that swings over runs away (Bock, Numerical
treatment of inverse problems, 1981; condensed by a Kalman smoother after Bell, SIAM J. Optim. 4(3), 1994).

Where the steps from a start do not settle, since within a chaotic motion a linearised model holds for short times only,
unmodelled forces are allowed beside the model's at first, which end its memory, and then taken away by degrees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.likelihood.coordinates import Coordinates
from drake_cafim.diagnosis.likelihood.flow import unsupported
from drake_cafim.diagnosis.likelihood.linearised import Linearised, linearise
from drake_cafim.diagnosis.noise.coloured import Memory
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices

ITERATIONS, SETTLED = 20, 0.03
"""Most steps, and the change of any parameter or reading, in standard deviations, at which they end."""
FREEDOMS, NEAR = (0.3, 0.03, 0.003), 1.0
"""Unmodelled forces, as shares of a joint's own, that are allowed one after the other; and the change, as above, at
which steps with such forces end."""
WORSE = 0.1
"""Rise of χ² that a step may make: that of a linearised model is not exact."""
SMALL_DAMPING, LARGE_DAMPING = 1e-3, 1e6
"""Levenberg's damping of a step after one that failed, and at which no step is tried again."""


@dataclass(frozen=True)
class WholeFit:
    """The estimate: its `model`, its covariance, and what is left.

    `information` and `prior_information` (c, c) are of the `coordinates.Coordinates`: unknowns, strengths, shapes.
    `states` are the smoothed trajectories (N, 2n) of each recording; `scores` (N, c) those of each sample, whose sum
    over all recordings is zero but for priors; `chi_square` is Σ νᵀ S⁻¹ ν of all readings, plus the priors' rows.
    """

    model: Model
    information: Array
    prior_information: Array
    chi_square: float
    degrees_of_freedom: int
    states: tuple[Array, ...]
    scores: tuple[Array, ...]
    settled: bool

    @property
    def covariance(self) -> Array:
        """(n + k, n + k) of unknowns and strengths, priors included."""
        plain = len(self.model.vector)
        return inverse(self.information + self.prior_information)[:plain, :plain]

    @property
    def std(self) -> Array:
        """(n + k,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def reduced_chi_square(self) -> float:
        """χ² per degree of freedom, 1 for noise alone."""
        return self.chi_square / max(self.degrees_of_freedom, 1)


def refuses(scene: Scene, forms: Sequence[WeakForm], model: Model) -> str:
    """Why the likelihood of these recordings cannot be had here; empty where it can."""
    if reason := unsupported(model.physics(scene)):
        return reason
    for form in forms:
        if any(isinstance(memory, Memory) for memory in form.samples.memories.values()):
            return "noise is correlated in time"
        if form.samples.commands:
            return "joints are driven by position servos"
        if isinstance(form.samples.windows, FilteredWindows):
            return "the efforts were filtered"
        if form.samples.bridges:
            return "a channel is sampled more slowly than the others"
    return ""


def fit_whole(
    scene: Scene, forms: Sequence[WeakForm], start: Model, iterations: int = ITERATIONS
) -> WholeFit | NotComputable:
    """The estimate near `start`, or why there is none."""
    if reason := refuses(scene, forms, start):
        return NotComputable(reason)
    found = compute(lambda: _maximise(scene, forms, start, iterations))
    if isinstance(found, WholeFit) and not np.all(np.isfinite(found.information)):
        return NotComputable("the simulated motion diverges")
    return found


@dataclass(frozen=True)
class _Point:
    """A model and trajectories with the recordings linearised about them, and the χ² of all."""

    model: Model
    states: list[Array]
    parts: list[Linearised]
    cost: float

    @property
    def information(self) -> Array:
        return np.asarray(sum(part.filtered.information for part in self.parts))

    @property
    def gradient(self) -> Array:
        return np.asarray(sum(part.filtered.gradient for part in self.parts))

    def after(self, change: Array) -> tuple[list[Array], float]:
        """The trajectories for parameters that change, and the largest change of a reading, in its std."""
        states, largest = [], 0.0
        for part, state in zip(self.parts, self.states, strict=True):
            moved = part.deviations(change)
            read = np.einsum("kms,ks->km", part.C, moved) / np.sqrt(part.R)
            largest = max(largest, float(np.max(np.abs(read))))
            states.append(state + moved[:, : state.shape[1]])
        return states, largest


def _maximise(scene: Scene, forms: Sequence[WeakForm], start: Model, iterations: int) -> WholeFit:
    climb = _Climb(scene, forms, Coordinates(scene, start), iterations)
    first = climb.at.first, [first_states(form, start, scene) for form in forms]
    best, settled = climb.climbed(*first)
    if not settled:
        model, states = first
        for freedom in FREEDOMS:
            freer, _ = climb.climbed(model, states, freedom)
            model, states = freer.model, freer.states
        again, settled = climb.climbed(model, states)
        best = again if settled or again.cost < best.cost else best
    rows = sum(int(np.sum(part.seen)) - state.shape[1] for part, state in zip(best.parts, best.states, strict=True))
    strengths = len(start.vector) - len(start.unknown) + len(start.free) + len(climb.at.shapes)
    scores = tuple(part.filtered.scores for part in best.parts)
    prior = np.diag(climb.at.prior_information)
    return WholeFit(
        best.model, best.information, prior, best.cost, rows - strengths, tuple(best.states), scores, settled
    )


@dataclass(frozen=True)
class _Climb:
    """Gauss–Newton steps of the parameters and of the trajectories of `forms`."""

    scene: Scene
    forms: Sequence[WeakForm]
    at: Coordinates
    iterations: int

    def point(self, model: Model, states: list[Array], freedom: float) -> _Point:
        at, physics, displaced = self.at, model.physics(self.scene), self.at.displaced(model)
        both = zip(self.forms, states, strict=True)
        parts = [linearise(form, physics, displaced, state, freedom) for form, state in both]
        cost = sum(part.filtered.chi_square for part in parts)
        cost += float(at.prior_information @ (at.of(model) - at.prior_mean) ** 2)
        return _Point(model, states, parts, cost)

    def climbed(self, model: Model, states: list[Array], freedom: float = 0.0) -> tuple[_Point, bool]:
        """The best point that steps from a model and trajectories reach, and whether they settled there.

        With a `freedom` (see `linearise`) it is on the way only, and `NEAR` is near enough.
        """
        at, prior, enough = self.at, self.at.prior_information, NEAR if freedom else SETTLED
        best, damping = self.point(model, states, freedom), 0.0
        for _ in range(self.iterations):
            x, information = at.of(best.model), best.information + np.diag(prior)
            size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
            scaled = information / np.outer(size, size) + damping * np.eye(len(size))
            gradient = (best.gradient - prior * (x - at.prior_mean)) / size
            model = at.model(x + np.linalg.lstsq(scaled, gradient, rcond=1e-13)[0] / size)
            change = at.of(model) - x
            states, moved = best.after(change)
            if damping < SMALL_DAMPING and moved < enough and np.all(np.abs(change) * size < enough):
                return best, True
            trial = self.point(model, states, freedom)
            if trial.cost < best.cost + WORSE:
                best, damping = trial, 0.1 * damping
                continue
            states, moved = best.after(np.zeros(len(size)))
            if moved >= enough:
                # of trajectories that have not settled χ² is not known yet, and no step is worse than it
                best = self.point(best.model, states, freedom)
            elif damping < LARGE_DAMPING:
                damping = max(10.0 * damping, SMALL_DAMPING)
            else:
                break
        return best, False


def inverse(information: Array) -> Array:
    """The inverse of an information matrix, whose rows may differ by many powers of ten."""
    size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    return np.asarray(np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size))


def first_states(form: WeakForm, model: Model, scene: Scene) -> Array:
    """(N, 2n) the recorded motion, smoothed; over samples that lack it a cubic that joins what is before and after."""
    samples, measured = form.samples, form.measurement(model.physics(scene))
    q, v = measured.q_hat.copy(), measured.v_hat.copy()
    columns, time = samples.recording.columns, samples.time
    kinds = ("q", "v") if samples.velocity_measured else ("q",)
    for j, name in enumerate(scene.tree.joint_names):
        there = np.all([np.isfinite(columns[f"{kind}.{name}"]) for kind in kinds], axis=0)
        known = np.flatnonzero(there)
        for before, after in pairwise(known.tolist()):
            if after == before + 1:
                continue
            inside = np.arange(before + 1, after)
            q[inside, j], v[inside, j] = _joining(time, q[:, j], v[:, j], before, after, inside)
    return np.concatenate([q, v], axis=1)


def _joining(time: Array, q: Array, v: Array, before: int, after: int, inside: Indices) -> tuple[Array, Array]:
    """The cubic Hermite polynomial and its slope at `inside`, between two samples."""
    h = time[after] - time[before]
    s = (time[inside] - time[before]) / h
    rise, bend = q[after] - q[before], h * (v[after] + v[before]) - 2.0 * (q[after] - q[before])
    lean = 3.0 * rise - h * (2.0 * v[before] + v[after])
    value = q[before] + s * (h * v[before] + s * (lean + s * bend))
    return value, (h * v[before] + s * (2.0 * lean + 3.0 * s * bend)) / h
