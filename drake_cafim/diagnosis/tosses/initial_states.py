"""Fit of the arcs' initial states to the measured poses, by damped Gauss–Newton steps.

Each arc has its own damping (Levenberg–Marquardt): where a point slides for a moment, the dependence on the initial
state is too nonlinear for full steps. One simulation of all arcs serves one step of each.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.thresholds import ARC_RESTART_CHI_SQUARE, ARC_RESTART_CHI_SQUARE_SHARE
from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.innovation import Innovation
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot, select_arcs
from drake_cafim.diagnosis.tosses.tangent import displace
from drake_cafim.dynamics.free_body_state import State, replace_rows, select
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

ROUNDS = 8
"""Largest number of steps, with the slopes computed again after each."""
SETTLED, NEAR = 0.1, 1.0
"""Predicted decrease of an arc's χ² below which no further step is taken, with new slopes and with fixed ones: the
innovations do not depend on the rest to first order. In units of the arc's χ² per degree of freedom, since where
physics is missing no initial state fits."""
SECOND_LOOKS = 2
"""Largest number of restarts of arcs that misfit."""
FIRST_DAMPING, HARDER, EASIER = 1e-3, 100.0, 1.0 / 30.0
"""The damping after the first step that fails, and its factors after a failed and after a successful step."""
LEAST_DAMPING = 1e-12
"""Keeps the step finite: a component of a state that the samples do not determine stays as it is."""


@dataclass(frozen=True)
class FittedArcs:
    """Simulated arcs with the linear least-squares problem for better initial states.

    To first order a change δx of an arc's initial state gives χ² = ‖R δx + z‖² + const., with R the `innovation`'s
    triangle and z the `misfit` (B, 12). `damping` (B,) is that of the next step, and `near` the smallest predicted
    decrease of χ² for which a step is taken.
    """

    shot: Shot
    innovation: Innovation
    misfit: Array
    damping: Array
    near: float

    @classmethod
    def of(cls, shot: Shot, innovation: Innovation, damping: Array | None = None, near: float = NEAR) -> "FittedArcs":
        """The least-squares problem of a shot, by the filter `innovation`."""
        misfit = innovation(shot.rows[..., None])[1][..., 0]
        return cls(shot, innovation, misfit, np.zeros(len(shot.start)) if damping is None else damping, near)

    @cached_property
    def cost(self) -> Array:
        """(B,) χ² of each arc."""
        return _cost(self.shot)

    @cached_property
    def far(self) -> Flags:
        """(B,) the arcs that misfit far more than the median arc."""
        left = self.cost / _freedom(self.shot)
        return np.asarray(left > ARC_RESTART_CHI_SQUARE * max(1.0, float(np.median(left))))

    @cached_property
    def improvable(self) -> Flags:
        """(B,) the arcs whose predicted decrease of χ² is worth a step."""
        change = self._change(self.misfit)
        left = self.misfit + np.einsum("bij,bj->bi", self.innovation.triangle, change)
        promised = np.sum(self.misfit**2, axis=1) - np.sum(left**2, axis=1)
        return np.asarray(promised > self.near * np.maximum(self.cost / _freedom(self.shot), 1.0))

    def predict_start(self, added: Array) -> State:
        """The initial states that minimise χ² when `added` (B, 12) is added to the misfit z."""
        return displace(self.shot.start, self._change(self.misfit + added))

    def improve(self, memory: Array | None) -> "FittedArcs":
        """The arcs after a step of those that are `improvable`; a step that raises χ² is undone and damps the next."""
        shot, wanted = self.shot, self.improvable
        start = displace(shot.start, np.where(wanted[:, None], self._change(self.misfit), 0.0))
        trial = FittedArcs.of(shot.simulate_again(wanted, start, memory), self.innovation)
        better = trial.cost < self.cost
        slower = np.maximum(self.damping * HARDER, FIRST_DAMPING)
        damping = np.where(wanted, np.where(better, self.damping * EASIER, slower), self.damping)
        if np.all(better | ~wanted):
            shot = trial.shot
        elif np.any(better & wanted):
            shot = select_arcs(better & wanted, trial.shot, shot)
        return FittedArcs.of(shot, self.innovation, damping, self.near)

    def _change(self, misfit: Array) -> Array:
        """The damped step (B, 12) −(RᵀR + λ D)⁻¹ Rᵀ z for z = `misfit`, with D the squared column norms of R."""
        size = np.linalg.norm(self.innovation.triangle, axis=1)
        size = np.where(size > 0.0, size, 1.0)
        scaled = self.innovation.triangle / size[:, None, :]
        turned = np.swapaxes(scaled, 1, 2)
        normal = turned @ scaled + np.maximum(self.damping, LEAST_DAMPING)[:, None, None] * np.eye(12)
        return np.asarray(-np.linalg.solve(normal, turned @ misfit[:, :, None])[..., 0] / size)


def fit_initial_states(arcs: Arcs, noise: PoseNoise, physics: Physics, start: State) -> FittedArcs:
    """The arcs from the initial states that fit best under `physics`; the fit begins at `start` (B).

    After an impact on an edge an arc may converge to the wrong side of it. An arc that misfits far more than the others
    is therefore fitted again from the end of the arc before it or, if it is the first of its recording, from the fitted
    initial state of its first half.
    """
    fitted = _fit_from(arcs, noise, physics, start)
    for _ in range(SECOND_LOOKS):
        far, follows = fitted.far, _follows(arcs)
        if not np.any(far):
            break
        onwards = select(far & follows, _from_before(fitted.shot), fitted.shot.start)
        first = np.flatnonzero(far & ~follows)
        if len(first):
            half = _fit_from(arcs[first].first_halves, noise, physics, start[first])
            onwards = replace_rows(onwards, first, half.shot.start)
        other = _fit_from(arcs, noise, physics, onwards)
        better = other.cost < ARC_RESTART_CHI_SQUARE_SHARE * fitted.cost
        if not np.any(better):
            break
        shot = select_arcs(better, other.shot, fitted.shot)
        damping = np.where(better, other.damping, fitted.damping)
        fitted = FittedArcs.of(shot, _innovation_of(shot, fitted.shot, fitted.innovation), damping)
    return fitted


def shoot_from_better_start(
    arcs: Arcs, noise: PoseNoise, physics: Physics, start: State, memory: Array | None = None
) -> Shot:
    """The arcs simulated from `start`, or from the first estimate by their samples, whichever fits better.

    Initial states that were fitted under wrong physics may lie so far off that a fit under better physics does not
    converge from there.
    """
    shot = Shot.of(arcs, noise, physics, start, memory)
    if start is arcs.start:
        return shot
    guessed = Shot.of(arcs, noise, physics, arcs.start, memory)
    return select_arcs(_cost(guessed) < _cost(shot), guessed, shot)


def shoot_from_predicted_start(before: FittedArcs, physics: Physics, start: State, memory: Array | None) -> Shot:
    """The arcs simulated from `start`, predicted to first order beside `before`; where far worse, from its own starts.

    The first order says nothing where a small change of an initial state makes another edge strike the ground.
    """
    shot = Shot.of(before.shot.arcs, before.shot.noise, physics, start, memory)
    worse = ARC_RESTART_CHI_SQUARE_SHARE * _cost(shot) > before.cost
    if not np.any(worse):
        return shot
    unmoved = shot.simulate_again(worse, before.shot.start, memory)
    better = _cost(unmoved) < _cost(shot)
    return select_arcs(better, unmoved, shot) if np.any(better) else shot


def _cost(shot: Shot) -> Array:
    """χ² of each arc, (B,); infinite where it is not a number."""
    cost = np.sum(shot.rows**2, axis=(1, 2))
    return np.asarray(np.where(np.isfinite(cost), cost, np.inf))


def _fit_from(arcs: Arcs, noise: PoseNoise, physics: Physics, start: State) -> FittedArcs:
    """Up to `ROUNDS` steps from `start`, with new slopes and new initial contact memories after each."""
    shot, body = shoot_from_better_start(arcs, noise, physics, start), FreeBody(physics)
    memory = shot.memory_at_start(body)
    if memory is not None:
        shot = Shot.of(arcs, noise, physics, shot.start, memory)
    fitted = FittedArcs.of(shot, Innovation.of(shot.start_jacobian), near=SETTLED)
    for _ in range(ROUNDS):
        if not np.any(fitted.improvable):
            break
        before, fitted = fitted.shot, fitted.improve(memory)
        if fitted.shot is not before:
            memory = fitted.shot.memory_at_start(body)
            innovation = _innovation_of(fitted.shot, before, fitted.innovation)
            fitted = FittedArcs.of(fitted.shot, innovation, fitted.damping, SETTLED)
    return replace(fitted, near=NEAR)


def _innovation_of(shot: Shot, before: Shot, known: Innovation) -> Innovation:
    """The filter of `shot`, in which arcs with the same initial state as `before` keep their `known` one.

    Not where contacts have a memory, since the finite steps of its derivatives depend on all arcs together.
    """
    new = np.any(shot.start.numbers != before.start.numbers, axis=1)
    if shot.body.touch_points.memory or np.all(new):
        return Innovation.of(shot.start_jacobian)
    return known.replace_flights(new, Innovation.of(shot[new].start_jacobian)) if np.any(new) else known


def _freedom(shot: Shot) -> Array:
    """Degrees of freedom of each arc, (B,): six (three) a sample, less twice that of its initial state, at least 1."""
    return np.asarray(np.maximum(shot.noise.rows * (shot.arcs.counts - 2), 1), dtype=float)


def _follows(arcs: Arcs) -> Flags:
    """(B,) whether the arc continues the recording of the arc before it."""
    return np.append(False, arcs.recording[1:] == arcs.recording[:-1])


def _from_before(shot: Shot) -> State:
    """Initial states (B) extrapolated at constant velocity from the last sample of the arc before each."""
    arcs = shot.arcs
    B, S = shot.flights.shape
    before = np.maximum(np.arange(B) - 1, 0)
    last = arcs.counts[before] - 1
    ended = shot.flights.at_samples[before * S + last]
    between = (arcs.times[:, 0] - arcs.times[before, last])[:, None]
    return displace(ended, np.concatenate([between * ended.v, between * ended.w, np.zeros((B, 6))], axis=1))
