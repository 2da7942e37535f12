"""Tosses against a scene: the likelihood of tracked poses by multiple shooting, as whitened innovations.

Each arc is simulated from a state of its own, which is fitted with whatever a model says; the rows are what its
samples say beyond that state. Regressors come from simulations and hold no noise of the measurement.
"""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.initial_states import Settled, settled_from, shoot_from_better_start
from drake_cafim.diagnosis.tosses.jacobian import number_columns
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.diagnosis.tosses.state import State
from drake_cafim.dynamics.tree import FREE
from drake_cafim.numerics.cache import make_room
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

CORRECTIONS = 2
"""Steps of the arcs' beginnings, at most, when a model's numbers change."""
FIRST = 2
"""Samples of an arc that its initial state takes up."""


@dataclass(frozen=True)
class TossRun:
    """One recording's part of the rows: `windows` samples of six rows each."""

    name: str
    windows: int
    time: Array
    """(windows,) s of the samples."""
    rows_per_window: ClassVar[int] = 6

    @property
    def shape(self) -> tuple[int, int]:
        return (self.windows, self.rows_per_window)

    @property
    def rows(self) -> int:
        return self.windows * self.rows_per_window


@dataclass(frozen=True)
class Lead:
    """A model's arcs, and what other numbers would have its samples say of their beginnings: (B, 12, n) a number."""

    vector: Array
    settled: Settled
    by_numbers: Array


@dataclass(frozen=True)
class ArcRows(Problem):
    """Arcs of one scene."""

    scene: Scene
    runs: tuple[TossRun, ...]
    arcs: Arcs
    noise: PoseNoise
    base: Settled
    first: Model
    """Where a fit of the unknowns begins."""
    found_pushes: list[Any] = field(default_factory=list, repr=False, compare=False)
    """The last residual that was searched for pushes, and what was found."""
    _shots: dict[Any, Settled] = field(default_factory=dict, repr=False, compare=False)
    _leads: dict[Any, Lead] = field(default_factory=dict, repr=False, compare=False)

    regressors_noisy: ClassVar[bool] = False
    least_gain: ClassVar[float] = 0.05
    slack: ClassVar[float] = 1e-3
    least_damping: ClassVar[float] = 1e-2

    @classmethod
    def settled(cls, scene: Scene, arcs: Arcs, noise: PoseNoise, model: Model, start: State | None = None) -> Self:
        """The problem whose rows are white under `model`."""
        base = settled_from(arcs, noise, model.physics(scene), start or arcs.start)
        return cls(scene, _runs(arcs), arcs, noise, base, model)

    @classmethod
    def nominally(cls, scene: Scene, arcs: Arcs, noise: PoseNoise) -> Self:
        """The problem under the scene's own physics.

        Where something strikes an edge, numbers that are a little off miss by so much that slopes mean nothing, and
        arcs settle on its wrong side, from where better numbers find no way back. So the arcs that the prior means
        tell well say what the unknowns are, and all begin anew from their samples.
        """
        given = Model(scene.priors.mean)
        problem = cls.settled(scene, arcs, noise, given)
        near = np.flatnonzero(~problem.base.far)
        if len(near) == len(problem.base.far):
            return problem
        told = fit(cls.settled(scene, arcs[near], noise, given, problem.base.shot.start[near]), given).model
        anew = cls.settled(scene, arcs, noise, told)
        # where physics is missing, arcs are far off under these numbers as well, and samples are no better a start
        return replace(problem, first=told) if np.any(anew.base.far) else anew

    def nominal(self) -> Model:
        return self.first

    def rewhitened(self, model: Model) -> Self:
        """The same arcs under another model."""
        return self.settled(self.scene, self.arcs, self.noise, model, self.shot(model).start)

    def plausible(self, model: Model) -> bool:
        return all(effect.plausible() for effect in model.effects)

    def rows_of(self, model: Model) -> Array:
        innovations = self.base.innovation(self.shot(model).rows[..., None])[0]
        return np.asarray(self.ordered(innovations)[:, 0])

    def jacobian(self, model: Model) -> Array:
        settled = self._settled(model)
        innovations, carried = self.base.innovation(number_columns(self.scene, settled.shot, model))
        self._leads[_kind(model)] = Lead(model.vector, settled, carried)
        columns = self.ordered(innovations)
        priors = np.zeros((len(model.unknown), columns.shape[1]))
        priors[:, : len(model.unknown)] = np.diag(1.0 / self.scene.priors.std)
        return np.concatenate([columns, priors])

    @property
    def body(self) -> str:
        """The tracked body."""
        return next(body.name for body in self.scene.tree.bodies if body.joint == FREE)

    def innovations(self, rows: Array) -> Array:
        """Columns (R, k) of whitened rows (B, S, 6, k)."""
        return self.ordered(self.base.innovation(rows)[0])

    def ordered(self, innovations: Array) -> Array:
        """(R, k) of innovations (B, S, 6, k): recording after recording, arc after arc, sample after sample."""
        # the size is spelled out: a model without numbers has no columns, k = 0
        return np.asarray(innovations[counted(self.arcs)].reshape(self.rows, innovations.shape[3]), dtype=float)

    def shot(self, model: Model) -> Shot:
        """The arcs under `model`, from states that fit it; the last few are kept."""
        return self._settled(model).shot

    def lead(self, model: Model, shot: Shot) -> None:
        """Arcs of models like `model` begin as those of `shot`, which settled under it, from now on."""
        self._shots[_kind(model), model.vector.tobytes()] = Settled.of(shot, self.base.innovation)
        self.jacobian(model)

    def _settled(self, model: Model) -> Settled:
        key = (_kind(model), model.vector.tobytes())
        if key not in self._shots:
            make_room(self._shots, 6)
            self._shots[key] = self._fitted(model)
        return self._shots[key]

    def _fitted(self, model: Model) -> Settled:
        physics, before = model.physics(self.scene), self.base
        memory = before.shot.memory_at_start(FreeBody(physics))
        lead = self._leads.get(_kind(model))
        if lead is None:
            shot = shoot_from_better_start(self.arcs, self.noise, physics, before.shot.start, memory)
        else:
            before = lead.settled
            start = before.moved_start(lead.by_numbers @ (model.vector - lead.vector))
            shot = Shot.of(self.arcs, self.noise, physics, start, memory)
        settled = Settled.of(shot, self.base.innovation, before.damping)
        for _ in range(CORRECTIONS):
            if not np.any(settled.unsettled):
                break
            settled = settled.corrected(memory)
        return settled


def counted(arcs: Arcs) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """(B, S) the samples whose innovations count."""
    return arcs.held & (np.arange(arcs.times.shape[1]) >= FIRST)


def _runs(arcs: Arcs) -> tuple[TossRun, ...]:
    keep = counted(arcs)
    runs = []
    for index, track in enumerate(arcs.tracks):
        own = arcs.recording == index
        runs.append(TossRun(track.recording.name, int(keep[own].sum()), arcs.times[own][keep[own]]))
    return tuple(runs)


def _kind(model: Model) -> tuple[Any, ...]:
    """What models of the same effects with other strengths share."""
    return tuple(
        (*effect.key, effect.episode and effect.episode.recording, *(effect.values[one.name] for one in effect.shapes))
        for effect in model.effects
    )
