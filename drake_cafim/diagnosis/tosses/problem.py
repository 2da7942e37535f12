"""Tosses against a scene: the likelihood of tracked poses by multiple shooting, as whitened innovations.

Each arc is simulated from a state of its own, which is fitted with whatever a model says; the rows are what its
samples say beyond that state. Regressors come from simulations and hold no noise of the measurement.
"""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.columns import number_columns
from drake_cafim.diagnosis.tosses.free_body import FreeBody, State
from drake_cafim.diagnosis.tosses.innovation import Innovation
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.shots import Shot, chosen
from drake_cafim.diagnosis.tosses.tangent import moved
from drake_cafim.dynamics.tree import FREE
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

SETTLES = 8
"""Corrections of the states that arcs begin with, at most, when the noise is reckoned anew."""
CORRECTIONS = 2
"""Of them for another model."""
SETTLED, NEAR = 0.3, 1.0
"""Standard deviations that an arc's beginning may still want to move, where slopes are taken anew and where not: the
rows do not see it to first order."""
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
class Base:
    """A shot that the arcs were settled with, and the innovations that follow from its slopes."""

    shot: Shot
    innovation: Innovation


@dataclass(frozen=True)
class Lead:
    """Where a model's arcs began, and how they would begin at other numbers: δx = `slope` (B, 12, n) δvector."""

    vector: Array
    start: State
    slope: Array


@dataclass(frozen=True)
class TossProblem(Problem):
    """Arcs of one scene. Vectors over rows hold all recordings', then one row a prior."""

    runs: tuple[TossRun, ...] = ()  # type: ignore[assignment]
    arcs: Arcs = None  # type: ignore[assignment]
    noise: PoseNoise = None  # type: ignore[assignment]
    base: Base = None  # type: ignore[assignment]
    _shots: dict[Any, Shot] = field(default_factory=dict, repr=False, compare=False)
    _leads: dict[Any, Lead] = field(default_factory=dict, repr=False, compare=False)

    regressors_noisy: ClassVar[bool] = False
    least_gain: ClassVar[float] = 0.05

    @classmethod
    def settled(
        cls, scene: Scene, arcs: Arcs, noise: PoseNoise, model: Model, start: State | None = None
    ) -> "TossProblem":
        """The problem whose rows are white under `model`."""
        base = settled_base(arcs, noise, model.physics(scene), start or arcs.start)
        return cls(scene, _runs(arcs), arcs=arcs, noise=noise, base=base)

    def rewhitened(self, model: Model) -> "TossProblem":
        """The same arcs under another model."""
        return self.settled(self.scene, self.arcs, self.noise, model, self.shot(model).start)

    @property
    def rows(self) -> int:
        return sum(run.rows for run in self.runs)

    def plausible(self, model: Model) -> bool:
        return all(effect.plausible() for effect in model.effects)

    def residual(self, model: Model) -> Array:
        innovations = self.base.innovation(self.shot(model).rows[..., None])[0]
        priors = self.scene.priors
        return np.concatenate([self.ordered(innovations)[:, 0], (model.unknown - priors.mean) / priors.std])

    def jacobian(self, model: Model) -> Array:
        shot = self.shot(model)
        innovations, begun = self.base.innovation(number_columns(self.scene, shot, model))
        self._leads[_kind(model)] = Lead(model.vector, shot.start, -begun)
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
        return np.asarray(innovations[counted(self.arcs)].reshape(-1, innovations.shape[3]), dtype=float)

    def shot(self, model: Model) -> Shot:
        """The arcs under `model`, from states that fit it; the last few are kept."""
        key = (_kind(model), model.vector.tobytes())
        if key not in self._shots:
            while len(self._shots) >= 6:
                self._shots.pop(next(iter(self._shots)))
            self._shots[key] = self._fitted(model)
        return self._shots[key]

    def _fitted(self, model: Model) -> Shot:
        physics = model.physics(self.scene)
        memory = self.base.shot.memory_at_start(FreeBody(physics))
        start = self.base.shot.start
        lead = self._leads.get(_kind(model))
        if lead is not None:
            start = moved(lead.start, lead.slope @ (model.vector - lead.vector))
        best = Shot.of(self.arcs, self.noise, physics, start, memory)
        return _corrected(best, self.base.innovation, CORRECTIONS, memory, NEAR)


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


def settled_base(arcs: Arcs, noise: PoseNoise, physics: Physics, start: State) -> Base:
    """The arcs from the states that fit `physics` best, by slopes that are taken anew each time."""
    shot = Shot.of(arcs, noise, physics, start)
    body = FreeBody(physics)
    memory = shot.memory_at_start(body)
    if memory is not None:
        shot = Shot.of(arcs, noise, physics, start, memory)
    innovation = Innovation.of(shot.by_start)
    for _ in range(SETTLES):
        before = shot
        shot = _corrected(shot, innovation, 1, memory, SETTLED)
        if shot is before:
            break
        memory = shot.memory_at_start(body)
        innovation = Innovation.of(shot.by_start)
    return Base(shot, innovation)


def _corrected(shot: Shot, innovation: Innovation, times: int, memory: Array | None, near: float) -> Shot:
    """The shot from better initial states; arcs that a step makes worse take a shorter one, or stay."""
    share = np.ones(len(shot.start))
    cost, (wanted, size) = _cost(shot), _wanted(shot, innovation)
    for _ in range(times):
        if not np.any((size > near) & (share > 0.01)):
            break
        start = moved(shot.start, wanted * np.where(size > near, share, 0.0)[:, None])
        trial = Shot.of(shot.arcs, shot.noise, shot.physics, start, memory)
        trial_cost = _cost(trial)
        better = trial_cost < cost
        if np.all(better | (size <= near)):
            shot = trial
        elif np.any(better):
            shot = chosen(better, trial, shot)
        share = np.where(better, np.minimum(4.0 * share, 1.0), 0.2 * share)
        cost = np.where(better, trial_cost, cost)
        wanted, size = _wanted(shot, innovation)
    return shot


def _cost(shot: Shot) -> Array:
    cost = np.sum(shot.rows**2, axis=(1, 2))
    return np.asarray(np.where(np.isfinite(cost), cost, np.inf))


def _wanted(shot: Shot, innovation: Innovation) -> tuple[Array, Array]:
    """What would have to change in the initial states (B, 12), and by how many standard deviations at most (B,)."""
    change = -innovation(shot.rows[..., None])[1][..., 0]
    size = np.max(np.abs(np.einsum("bij,bj->bi", innovation.triangle, change)), axis=1)
    return change, size


def _kind(model: Model) -> tuple[Any, ...]:
    """What models of the same effects with other strengths share."""
    return tuple(
        (*effect.key, getattr(effect, "recording", None), *(effect.values[one.name] for one in effect.shapes))
        for effect in model.effects
    )
