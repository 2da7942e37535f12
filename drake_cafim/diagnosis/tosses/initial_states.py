"""The states that arcs begin with, brought to where they fit what was measured best.

Gauss–Newton steps, each arc damped on its own (Levenberg, Marquardt): what slides for a moment bends too much for
full ones. One simulation of all arcs serves a step of each.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.thresholds import ARC_RESTART_CHI_SQUARE, ARC_RESTART_CHI_SQUARE_SHARE
from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.innovation import Innovation
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot, chosen
from drake_cafim.diagnosis.tosses.state import State, picked, replaced
from drake_cafim.diagnosis.tosses.tangent import moved
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

ROUNDS = 8
"""Steps, at most, with slopes taken anew after each."""
SETTLED, NEAR = 0.1, 1.0
"""χ² that a step may still promise, where slopes are taken anew and where not: the rows do not see it to first
order. It counts in units of what the arc leaves, for where physics is missing no state fits."""
SECOND_LOOKS = 2
FIRST_DAMPING, HARDER, EASIER = 1e-3, 100.0, 1.0 / 30.0
LEAST_DAMPING = 1e-12
"""Where a flight under physics that is far off tells nothing of a state, that stays as it is."""


@dataclass(frozen=True)
class Settled:
    """A shot, and what its samples say of the states that the arcs should begin with.

    `carried` (B, 12) is the misfit along the `innovation`'s triangles, `damping` (B,) what the next step is damped by,
    and `near` the χ² that it may promise without being worth it.
    """

    shot: Shot
    innovation: Innovation
    carried: Array
    damping: Array
    near: float

    @classmethod
    def of(cls, shot: Shot, innovation: Innovation, damping: Array | None = None, near: float = NEAR) -> "Settled":
        """What `innovation` makes of the shot."""
        carried = innovation(shot.rows[..., None])[1][..., 0]
        return cls(shot, innovation, carried, np.zeros(len(shot.start)) if damping is None else damping, near)

    @cached_property
    def cost(self) -> Array:
        """(B,) χ² of each arc."""
        return _cost(self.shot)

    @cached_property
    def far(self) -> Flags:
        """(B,) the arcs that the physics tells far worse than the others."""
        left = self.cost / _freedom(self.shot.arcs)
        return np.asarray(left > ARC_RESTART_CHI_SQUARE * max(1.0, float(np.median(left))))

    @cached_property
    def unsettled(self) -> Flags:
        """(B,) the arcs that a step is worth taking for."""
        change = self._change(self.carried)
        left = self.carried + np.einsum("bij,bj->bi", self.innovation.triangle, change)
        promised = np.sum(self.carried**2, axis=1) - np.sum(left**2, axis=1)
        return np.asarray(promised > self.near * np.maximum(self.cost / _freedom(self.shot.arcs), 1.0))

    def moved_start(self, added: Array) -> State:
        """Where the arcs should begin when what the samples say is `added` (B, 12) to."""
        return moved(self.shot.start, self._change(self.carried + added))

    def corrected(self, memory: Array | None) -> "Settled":
        """After a step of the arcs that are worth one; those that it makes worse stay, and go slower from then on."""
        shot, wanted = self.shot, self.unsettled
        start = moved(shot.start, np.where(wanted[:, None], self._change(self.carried), 0.0))
        trial = Settled.of(shot.again(wanted, start, memory), self.innovation)
        better = trial.cost < self.cost
        slower = np.maximum(self.damping * HARDER, FIRST_DAMPING)
        damping = np.where(wanted, np.where(better, self.damping * EASIER, slower), self.damping)
        if np.all(better | ~wanted):
            shot = trial.shot
        elif np.any(better & wanted):
            shot = chosen(better & wanted, trial.shot, shot)
        return Settled.of(shot, self.innovation, damping, self.near)

    def _change(self, carried: Array) -> Array:
        """(B, 12) the damped step against `carried`."""
        size = np.linalg.norm(self.innovation.triangle, axis=1)
        size = np.where(size > 0.0, size, 1.0)
        scaled = self.innovation.triangle / size[:, None, :]
        turned = np.swapaxes(scaled, 1, 2)
        normal = turned @ scaled + np.maximum(self.damping, LEAST_DAMPING)[:, None, None] * np.eye(12)
        return np.asarray(-np.linalg.solve(normal, turned @ carried[:, :, None])[..., 0] / size)


def settled_from(arcs: Arcs, noise: PoseNoise, physics: Physics, start: State) -> Settled:
    """The arcs from the states that fit `physics` best, by slopes that are taken anew each time.

    `start` (B) is where to begin. An arc that strikes an edge may settle on its wrong side; what is left far from the
    samples then begins once more where the arc before it ended or, where there is none, as its own first half did.
    """
    settled = _settled_near(arcs, noise, physics, start)
    for _ in range(SECOND_LOOKS):
        far, follows = settled.far, _follows(arcs)
        if not np.any(far):
            break
        onwards = picked(far & follows, _from_before(settled.shot), settled.shot.start)
        first = np.flatnonzero(far & ~follows)
        if len(first):
            half = _settled_near(arcs[first].first_halves, noise, physics, start[first])
            onwards = replaced(onwards, first, half.shot.start)
        other = _settled_near(arcs, noise, physics, onwards)
        better = other.cost < ARC_RESTART_CHI_SQUARE_SHARE * settled.cost
        if not np.any(better):
            break
        shot = chosen(better, other.shot, settled.shot)
        damping = np.where(better, other.damping, settled.damping)
        settled = Settled.of(shot, _innovation_of(shot, settled.shot, settled.innovation), damping)
    return settled


def shoot_from_better_start(
    arcs: Arcs, noise: PoseNoise, physics: Physics, start: State, memory: Array | None = None
) -> Shot:
    """The arcs from `start` or, each that fits better so, from where its own samples have it.

    Under physics that is far off, arcs settle far from their samples, from where the right one finds no way back.
    """
    shot = Shot.of(arcs, noise, physics, start, memory)
    if start is arcs.start:
        return shot
    guessed = Shot.of(arcs, noise, physics, arcs.start, memory)
    return chosen(_cost(guessed) < _cost(shot), guessed, shot)


def _cost(shot: Shot) -> Array:
    """(B,) χ² of each arc."""
    cost = np.sum(shot.rows**2, axis=(1, 2))
    return np.asarray(np.where(np.isfinite(cost), cost, np.inf))


def _settled_near(arcs: Arcs, noise: PoseNoise, physics: Physics, start: State) -> Settled:
    shot, body = shoot_from_better_start(arcs, noise, physics, start), FreeBody(physics)
    memory = shot.memory_at_start(body)
    if memory is not None:
        shot = Shot.of(arcs, noise, physics, shot.start, memory)
    settled = Settled.of(shot, Innovation.of(shot.by_start), near=SETTLED)
    for _ in range(ROUNDS):
        if not np.any(settled.unsettled):
            break
        before, settled = settled.shot, settled.corrected(memory)
        if settled.shot is not before:
            memory = settled.shot.memory_at_start(body)
            innovation = _innovation_of(settled.shot, before, settled.innovation)
            settled = Settled.of(settled.shot, innovation, settled.damping, SETTLED)
    return replace(settled, near=NEAR)


def _innovation_of(shot: Shot, before: Shot, known: Innovation) -> Innovation:
    """The innovation of `shot`: of arcs that begin where they did `before` it is `known`.

    What contacts remember is the exception: its finite steps are those of all arcs together.
    """
    new = np.any(shot.start.numbers != before.start.numbers, axis=1)
    if shot.body.touch_points.memory or np.all(new):
        return Innovation.of(shot.by_start)
    return known.replaced(new, Innovation.of(shot[new].by_start)) if np.any(new) else known


def _freedom(arcs: Arcs) -> Array:
    """(B,) rows of each arc less what its beginning takes."""
    return np.asarray(np.maximum(6 * arcs.counts - 12, 1), dtype=float)


def _follows(arcs: Arcs) -> Flags:
    """(B,) whether the arc goes on with the recording of the one before it."""
    return np.append(False, arcs.recording[1:] == arcs.recording[:-1])


def _from_before(shot: Shot) -> State:
    """(B) states at the arcs' beginnings if each went on from the last sample of the one before it."""
    arcs = shot.arcs
    B, S = shot.flights.shape
    before = np.maximum(np.arange(B) - 1, 0)
    last = arcs.counts[before] - 1
    ended = shot.flights.at_samples[before * S + last]
    between = (arcs.times[:, 0] - arcs.times[before, last])[:, None]
    return moved(ended, np.concatenate([between * ended.v, between * ended.w, np.zeros((B, 6))], axis=1))
