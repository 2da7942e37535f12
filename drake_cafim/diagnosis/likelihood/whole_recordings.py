"""The estimate of highest likelihood of whole recordings, by multiple shooting from every sample.

The trajectories and the parameters are found together: Gauss–Newton steps about trajectories that begin as the recorded
ones, whose steps need not join, so that neither an unstable motion nor one that swings over runs away (Bock,
multiple shooting, 1981; here condensed by a Kalman smoother, as Bell, SIAM J. Optim. 4(3), 1994). A step costs as much as
the samples are many.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.likelihood.flow import unsupported
from drake_cafim.diagnosis.likelihood.linearised import Displaced, Linearised, linearise
from drake_cafim.diagnosis.noise.coloured import Memory
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import UNKNOWN_REACH_IN_PRIOR_STDS
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DIFFERENCE = 1e-4
"""Displacement of a parameter, of its size."""
ITERATIONS, SETTLED = 15, 0.02
"""Most steps, and their size in standard deviations at which they end."""


@dataclass(frozen=True)
class WholeFit:
    """The estimate: its `model`, the information (n + k, n + k) of the recordings alone, and what is left.

    `states` are the smoothed trajectories (N, 2n) of each recording; `scores` (N, n + k) of each sample, whose sum over
    all recordings is zero but for priors; `chi_square` is Σ νᵀ S⁻¹ ν of `readings` readings, plus the priors' rows.
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
        """(n + k, n + k), priors included."""
        return np.asarray(np.linalg.inv(self.information + self.prior_information))

    @property
    def std(self) -> Array:
        """(n + k,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def reduced_chi_square(self) -> float:
        return self.chi_square / max(self.degrees_of_freedom, 1)


def refuses(scene: Scene, forms: Sequence[WeakForm], model: Model) -> str:
    """Why the likelihood of these recordings cannot be had here; empty where it can."""
    if reason := unsupported(model.physics(scene)):
        return reason
    for form in forms:
        if any(isinstance(memory, Memory) for memory in form.samples.memories.values()):
            return "noise is correlated in time"
        if form.samples.bridges:
            return "a channel is sampled more slowly than the others"
    return ""


def fit_whole(
    scene: Scene, forms: Sequence[WeakForm], start: Model, iterations: int = ITERATIONS
) -> WholeFit | NotComputable:
    """The estimate near `start`; what cannot be computed says why."""
    if reason := refuses(scene, forms, start):
        return NotComputable(reason)
    prior = np.zeros(len(start.vector))
    prior[: len(start.unknown)] = (scene.priors.std * start.prior_std_ratios(scene)) ** -2.0
    means = np.concatenate([scene.priors.mean, np.zeros(len(start.vector) - len(start.unknown))])
    states = [first_states(form, start, scene) for form in forms]
    best: tuple[float, Model, list[Array], list[Linearised]] | None = None
    model, damping, settled = start, 0.0, False
    for _ in range(iterations):
        parts = _linearised(scene, forms, model, states)
        offset = prior * (model.vector - means)
        cost = sum(part.filtered.chi_square for part in parts) + float(offset @ (model.vector - means))
        if best is not None and not cost < best[0] * (1.0 + 1e-9) + 1e-3:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                break
        else:
            best, damping = (cost, model, states, parts), 0.1 * damping
        cost, model, states, parts = best
        information = sum((part.filtered.information for part in parts), np.zeros((len(prior), len(prior))))
        if not np.all(np.isfinite(information)):
            return NotComputable("the simulated motion diverges")
        gradient = sum((part.filtered.gradient for part in parts), -prior * (model.vector - means))
        whole = information + np.diag(prior)
        size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        scaled = whole / np.outer(size, size) + damping * np.eye(len(size))
        change = np.linalg.lstsq(scaled, gradient / size, rcond=1e-13)[0] / size
        after = _within(scene, start, model.at(model.vector + change))
        change = after.vector - model.vector
        settled = bool(np.all(np.abs(change) * size < SETTLED)) and damping < 1e-2
        moved = [part.deviations(change)[:, : state.shape[1]] for part, state in zip(parts, states, strict=True)]
        joined = max(float(np.max(np.abs(part.c))) for part in parts)
        if settled and joined < 1e-9 + 0.02 * float(np.min(np.sqrt(parts[0].R))):
            break
        model, states = after, [state + more for state, more in zip(states, moved, strict=True)]
    if best is None:
        return NotComputable("no step was taken")
    cost, model, states, parts = best
    information = sum((part.filtered.information for part in parts), np.zeros((len(prior), len(prior))))
    rows = sum(int(np.sum(part.seen)) - states[0].shape[1] for part in parts)
    strengths = len(start.vector) - len(start.unknown) + len(start.free)
    scores = tuple(part.filtered.scores for part in parts)
    return WholeFit(model, information, np.diag(prior), cost, rows - strengths, tuple(states), scores, settled)


def information_of(scene: Scene, forms: Sequence[WeakForm], model: Model, states: Sequence[Array] | None = None) -> Array:
    """(n + k, n + k) Fisher information of the recordings about unknowns and strengths, initial states projected out."""
    states = states or [first_states(form, model, scene) for form in forms]
    parts = _linearised(scene, forms, model, states)
    return np.asarray(sum(part.filtered.information for part in parts))


def _linearised(scene: Scene, forms: Sequence[WeakForm], model: Model, states: Sequence[Array]) -> list[Linearised]:
    physics, displaced = model.physics(scene), []
    for index, size in enumerate(_sizes(scene, model)):
        step = np.zeros(len(model.vector))
        step[index] = DIFFERENCE * size
        ahead = model.at(model.vector + step)
        if ahead.vector[index] == model.vector[index]:
            step = -step
            ahead = model.at(model.vector + step)
        displaced.append(Displaced(ahead.physics(scene), float(step[index])))
    return [linearise(form, physics, displaced, state) for form, state in zip(forms, states, strict=True)]


def _sizes(scene: Scene, model: Model) -> Array:
    strengths = [
        max(0.1 * s.typical, min(s.typical, abs(value - s.nominal)))
        for effect in model.effects
        for s, value in zip(effect.strengths, effect.vector, strict=True)
    ]
    return np.concatenate([scene.priors.std, strengths])


def _within(scene: Scene, start: Model, model: Model) -> Model:
    """The model with its unknowns within reach of their priors and in their bounds."""
    reach = UNKNOWN_REACH_IN_PRIOR_STDS * scene.priors.std * start.prior_std_ratios(scene)
    near = np.clip(model.unknown, scene.priors.mean - reach, scene.priors.mean + reach)
    return replace(model, unknown=scene.priors.clip(near))


def first_states(form: WeakForm, model: Model, scene: Scene) -> Array:
    """(N, 2n) the recorded motion, smoothed; over samples that lack it a cubic that joins what is before and after."""
    samples, measured = form.samples, form.measurement(model.physics(scene))
    q, v = measured.q_hat.copy(), measured.v_hat.copy()
    columns, time = samples.recording.columns, samples.time
    kinds = ("q", "v") if samples.velocity_measured else ("q",)
    for j, name in enumerate(scene.tree.joint_names):
        there = np.all([np.isfinite(columns[f"{kind}.{name}"]) for kind in kinds], axis=0)
        known = np.flatnonzero(there)
        for before, after in pairwise(known):
            if after == before + 1:
                continue
            inside = np.arange(before + 1, after)
            q[inside, j], v[inside, j] = _joining(time, q[:, j], v[:, j], before, after, inside)
    return np.concatenate([q, v], axis=1)


def _joining(time: Array, q: Array, v: Array, before: int, after: int, inside: Array) -> tuple[Array, Array]:
    """The cubic Hermite polynomial and its slope at `inside`, between two samples."""
    h = time[after] - time[before]
    s = (time[inside] - time[before]) / h
    rise, bend = q[after] - q[before], h * (v[after] + v[before]) - 2.0 * (q[after] - q[before])
    lean = 3.0 * rise - h * (2.0 * v[before] + v[after])
    value = q[before] + s * (h * v[before] + s * (lean + s * bend))
    return value, (h * v[before] + s * (2.0 * lean + 3.0 * s * bend)) / h
