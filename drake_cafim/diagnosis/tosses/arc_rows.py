"""The likelihood of tracked poses under a scene, by multiple shooting, as whitened innovations.

Each arc is simulated from an initial state of its own, which is fitted anew under each model. The rows are the
innovations of its samples, from which that initial state is eliminated. Regressors are derivatives of simulations and
hold no measurement noise.
"""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import ARC_RESTART_CHI_SQUARE_SHARE
from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.initial_states import (
    FittedArcs,
    fit_initial_states,
    shoot_from_better_start,
    shoot_from_predicted_start,
)
from drake_cafim.diagnosis.tosses.jacobian import number_columns
from drake_cafim.diagnosis.tosses.poses import PoseNoise
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.dynamics.free_body_state import State
from drake_cafim.dynamics.tree import FREE
from drake_cafim.numerics.cache import make_room
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

CORRECTIONS = 2
"""Largest number of Gauss–Newton steps of the initial states when a model's parameters change."""
FIRST = 2
"""Number of an arc's samples that determine its 12 initial numbers, at 6 a sample; their innovations do not count."""


@dataclass(frozen=True)
class TossRun:
    """One recording's share of the rows: `windows` samples of six rows each, or of three of position alone."""

    name: str
    windows: int
    time: Array
    """(windows,) s of the samples."""
    rows_per_window: int = 6

    @property
    def shape(self) -> tuple[int, int]:
        """(samples, rows per sample)."""
        return (self.windows, self.rows_per_window)

    @property
    def rows(self) -> int:
        """The number of rows."""
        return self.windows * self.rows_per_window


@dataclass(frozen=True)
class Linearisation:
    """The fitted arcs of a model with parameters `vector` (n,), and ∂misfit/∂vector `by_numbers` (B, 12, n).

    With these the initial states of a model with slightly different parameters are predicted.
    """

    vector: Array
    fitted: FittedArcs
    by_numbers: Array


@dataclass(frozen=True)
class ArcRows(Problem):
    """The rows of all arcs under one scene; those of a model are white where its physics is the true one."""

    scene: Scene
    runs: tuple[TossRun, ...]
    arcs: Arcs
    noise: PoseNoise
    base: FittedArcs
    first: Model
    """The model at which a fit of the unknowns starts."""
    found_pushes: list[Any] = field(default_factory=list, repr=False, compare=False)
    """The last residual that was searched for pushes, and the pushes found."""
    _shots: dict[Any, FittedArcs] = field(default_factory=dict, repr=False, compare=False)
    _linearisations: dict[Any, Linearisation] = field(default_factory=dict, repr=False, compare=False)

    whitened_by_model: ClassVar[bool] = False
    least_gain: ClassVar[float] = 0.05
    slack: ClassVar[float] = 1e-3
    least_damping: ClassVar[float] = 1e-2

    @classmethod
    def linearised_at(
        cls, scene: Scene, arcs: Arcs, noise: PoseNoise, model: Model, start: State | None = None
    ) -> Self:
        """The problem whose innovations are linearised along the arcs under `model`, fitted from `start` (B)."""
        base = fit_initial_states(arcs, noise, model.physics(scene), start or arcs.start)
        return cls(scene, _runs(arcs, noise.rows), arcs, noise, base, model)

    @classmethod
    def at_nominal(cls, scene: Scene, arcs: Arcs, noise: PoseNoise) -> Self:
        """The problem linearised under the scene's nominal physics.

        At an impact on an edge, slightly wrong parameters cause errors far beyond the linear range, and an arc's
        initial state may converge to the wrong side of the edge, from where better parameters do not bring it back.
        Therefore the unknowns are first fitted to the arcs that the prior means fit well; then all arcs are fitted
        again from their own samples.
        """
        given = Model(scene.priors.mean)
        problem = cls.linearised_at(scene, arcs, noise, given)
        near = np.flatnonzero(~problem.base.far)
        if len(near) == len(problem.base.far):
            return problem
        fitted = fit(cls.linearised_at(scene, arcs[near], noise, given, problem.base.shot.start[near]), given).model
        anew = cls.linearised_at(scene, arcs, noise, fitted)
        # where physics is missing, some arcs misfit under these parameters as well, so the new start is no better
        return replace(problem, first=fitted) if np.any(anew.base.far) else anew

    def nominal(self) -> Model:
        return self.first

    def rewhitened(self, model: Model) -> Self:
        """The problem of the same arcs, linearised under another model."""
        return self.linearised_at(self.scene, self.arcs, self.noise, model, self.shot(model).start)

    def better_start(self, model: Model) -> Model | None:
        """The fit to arcs that are fitted anew under `model`, where it halves the excess of χ² over the number of rows.

        Fits of `self` go on from its arcs. While a fit changes the parameters, an arc's initial state takes a few steps
        only: one that is on the wrong side of an edge stays there, and better parameters then fit worse.
        """
        left = self.rows_of(model)
        excess = float(left @ left) - self.rows
        if excess <= 0.0:
            return None
        anew = self.rewhitened(model)
        better = fit(anew, model)
        if not better.chi_square - self.rows < ARC_RESTART_CHI_SQUARE_SHARE * excess:
            return None
        self.seed(better.model, anew.shot(better.model))
        return better.model

    def plausible(self, model: Model) -> bool:
        return all(effect.plausible() for effect in model.effects)

    def rows_of(self, model: Model) -> Array:
        innovations = self.base.innovation(self.shot(model).rows[..., None])[0]
        return np.asarray(self.order_rows(innovations)[:, 0])

    def jacobian(self, model: Model) -> Array:
        fitted = self._fitted_arcs(model)
        innovations, misfits = self.base.innovation(number_columns(self.scene, fitted.shot, model))
        self._linearisations[_kind(model)] = Linearisation(model.vector, fitted, misfits)
        columns = self.order_rows(innovations)
        priors = np.zeros((len(model.unknown), columns.shape[1]))
        priors[:, : len(model.unknown)] = np.diag(1.0 / self.prior_std(model))
        return np.concatenate([columns, priors])

    @property
    def body(self) -> str:
        """The tracked body."""
        return next(body.name for body in self.scene.tree.bodies if body.joint == FREE)

    def innovations(self, rows: Array) -> Array:
        """Innovations (R, k) of whitened rows (B, S, 6, k), those that count."""
        return self.order_rows(self.base.innovation(rows)[0])

    def order_rows(self, innovations: Array) -> Array:
        """The innovations (R, k) that count of (B, S, 6, k), ordered by recording, arc and sample."""
        measured = innovations[innovation_mask(self.arcs)][:, : self.noise.rows]
        # the size is given in full: for a model without parameters k = 0, where reshape cannot infer it
        return np.asarray(measured.reshape(self.rows, innovations.shape[3]), dtype=float)

    def shot(self, model: Model) -> Shot:
        """The arcs simulated under `model` from fitted initial states; cached for the last few models."""
        return self._fitted_arcs(model).shot

    def seed(self, model: Model, shot: Shot) -> None:
        """Lets later fits of models with the effects of `model` start from the initial states of `shot`."""
        self._shots[_kind(model), model.vector.tobytes()] = FittedArcs.of(shot, self.base.innovation)
        self.jacobian(model)

    def _fitted_arcs(self, model: Model) -> FittedArcs:
        key = (_kind(model), model.vector.tobytes())
        if key not in self._shots:
            make_room(self._shots, 6)
            self._shots[key] = self._fit_starts(model)
        return self._shots[key]

    def _fit_starts(self, model: Model) -> FittedArcs:
        """The arcs under `model`; the fit starts where the last linearisation with the same effects predicts."""
        physics, before = model.physics(self.scene), self.base
        memory = before.shot.memory_at_start(FreeBody(physics))
        linearisation = self._linearisations.get(_kind(model))
        if linearisation is None:
            shot = shoot_from_better_start(self.arcs, self.noise, physics, before.shot.start, memory)
        else:
            before = linearisation.fitted
            start = before.predict_start(linearisation.by_numbers @ (model.vector - linearisation.vector))
            shot = shoot_from_predicted_start(before, physics, start, memory)
        fitted = FittedArcs.of(shot, self.base.innovation, before.damping)
        for _ in range(CORRECTIONS):
            if not np.any(fitted.improvable):
                break
            fitted = fitted.improve(memory)
        return fitted


def innovation_mask(arcs: Arcs) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """(B, S) True for the samples whose innovations count: all but the first `FIRST` of each arc."""
    return arcs.held & (np.arange(arcs.times.shape[1]) >= FIRST)


def _runs(arcs: Arcs, rows: int) -> tuple[TossRun, ...]:
    keep = innovation_mask(arcs)
    runs = []
    for index, track in enumerate(arcs.tracks):
        own = arcs.recording == index
        runs.append(TossRun(track.recording.name, int(keep[own].sum()), arcs.times[own][keep[own]], rows))
    return tuple(runs)


def _kind(model: Model) -> tuple[Any, ...]:
    """A key that models with the same effects, episodes and shapes but other strengths have in common."""
    return tuple(
        (
            *effect.key,
            effect.episode and effect.episode.recording,
            *(effect.values[shape.name] for shape in effect.shapes),
        )
        for effect in model.effects
    )
