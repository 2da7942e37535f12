"""The fit to all parts of long recordings: Gauss–Newton steps, with one part's equations in memory at a time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Self

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.errors import InputError
from drake_cafim.kept import NOTHING_KEPT, Kept
from drake_cafim.parallel.forked import map_forked
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MOST_PASSES, SETTLED = 3, 0.1
"""Most passes over all parts, and the change, in standard deviations, at which they end."""
CHECKED = 8
"""Parts whose gradient is computed after a step."""
WORSE = 1.0
"""Rise of χ² that a step may make: one that corrects for noise in the regressors raises it a little."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class PartRows:
    """The whitened rows of one part at one model: `residual` (R,) and `jacobian` (R, n + k).

    `without` (R,) is the residual without the effects, under the same whitening; `offset` (n + k,) and `excess`
    (n + k, n + k) are those of `shared_noise`.
    """

    name: str
    shape: tuple[int, int]
    time: Array
    residual: Array
    jacobian: Array
    without: Array
    penalty: float
    offset: Array
    excess: Array
    noisy: bool

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.shape[0] * self.shape[1]

    @classmethod
    def of(cls, problem: WeakProblem, model: Model, acting: frozenset[Key]) -> "PartRows":
        """The rows of the one recording of `problem` at `model`, of whose effects those `acting` are there."""
        own, columns = acting_in(model, acting)
        run, every = problem.runs[0], problem.residual(own)
        jacobian = problem.jacobian(own)
        offset, excess = problem.shared_noise(own, every, jacobian)
        z = every[: problem.rows]
        without = problem.rows_of(replace(own, effects=())) if own.effects else z
        count = len(model.vector)
        whole, shared, doubled = np.zeros((problem.rows, count)), np.zeros(count), np.zeros((count, count))
        whole[:, columns], shared[columns], doubled[np.ix_(columns, columns)] = jacobian[: problem.rows], offset, excess
        return cls(
            run.name,
            run.shape,
            run.time,
            z,
            whole,
            without,
            problem.penalty(own),
            shared,
            doubled,
            problem.regressors_noisy,
        )


def acting_in(model: Model, acting: frozenset[Key]) -> tuple[Model, list[int]]:
    """The model with those of its effects whose keys are `acting`, and where its numbers stand in `model.vector`."""
    columns, at = list(range(len(model.unknown))), len(model.unknown)
    for effect in model.effects:
        if effect.key in acting:
            columns += range(at, at + len(effect.strengths))
        at += len(effect.strengths)
    return replace(model, effects=tuple(effect for effect in model.effects if effect.key in acting)), columns


@dataclass(frozen=True)
class AllRows(Problem):
    """The rows of all parts, linear about the model `about` at which they were computed."""

    scene: Scene
    runs: Sequence[PartRows]
    about: Model
    whitened_by_model = False
    _stacked: list[tuple[Array, Array]] = field(default_factory=list, repr=False, compare=False)

    @property
    def regressors_noisy(self) -> bool:
        return any(run.noisy for run in self.runs)

    @property
    def _rows(self) -> tuple[Array, Array]:
        if not self._stacked:
            both = np.concatenate([run.residual for run in self.runs]), np.concatenate([r.jacobian for r in self.runs])
            self._stacked.append(both)
        return self._stacked[0]

    def rewhitened(self, model: Model) -> Self:
        return self

    def plausible(self, model: Model) -> bool:
        return all(effect.plausible() for effect in model.effects)

    def rows_of(self, model: Model) -> Array:
        z, J = self._rows
        if self.about.effects and not model.effects:
            n = len(model.unknown)
            bare = np.concatenate([run.without for run in self.runs])
            return np.asarray(bare + J[:, :n] @ (model.unknown - self.about.unknown))
        return np.asarray(z + J @ (model.vector - self.about.vector))

    def jacobian(self, model: Model) -> Array:
        n, J = len(model.unknown), self._rows[1]
        prior = np.zeros((n, J.shape[1]))
        prior[:, :n] = np.diag(1.0 / self.prior_std(model))
        return np.concatenate([J, prior])

    def shared_noise(self, model: Model, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        offsets, excesses = [run.offset for run in self.runs], [run.excess for run in self.runs]
        return np.sum(offsets, axis=0), np.sum(excesses, axis=0)


@dataclass(frozen=True)
class FitOfAll:
    """The `fitted` model of all parts, its rows, χ² per row without its effects, and whether the steps `settled`."""

    problem: AllRows
    fitted: Fit
    before: float
    settled: bool


LayOut = Callable[[int, Model], WeakProblem]
"""Sets up the part of that number, whitened under a model. Raises `InputError` where it cannot be used."""


def fit_all(
    scene: Scene,
    lay_out: LayOut,
    acting: Sequence[frozenset[Key]],
    start: Model,
    progress: Progress = lambda text: None,
    jobs: int = 1,
    keep: Kept = NOTHING_KEPT,
) -> FitOfAll:
    """The fit near `start` to as many parts as `acting` has sets: of the effects that are there in each.

    Parts are independent given the parameters, each with its own initial state, so that each adds its own rows; `jobs`
    processes compute them. One that cannot be used adds none. Steps end where one is small, or where the gradient that
    remains after it is: that of `CHECKED` parts, spread evenly, stands for all. Rows that `keep` has are not computed
    again: those of the same pass at the same numbers.
    """

    def rows_of(number: int, model: Model) -> PartRows | None:
        with suppress(InputError):
            return PartRows.of(lay_out(number, acting_in(model, acting[number])[0]), model, acting[number])
        return None

    model, kept = start, None
    for sweep in range(MOST_PASSES):
        rows: list[PartRows | None] = []
        for found in _kept_rows(partial(rows_of, model=model), f"rows_{sweep}", model, len(acting), jobs, keep):
            rows.append(found)
            progress(f"fitting to all parts, pass {sweep + 1}: {len(rows)} of {len(acting)}")
        problem = AllRows(scene, tuple(own for own in rows if own is not None), model)
        if kept is not None and not _objective(problem, model) < _objective(kept.problem, kept.problem.about) + WORSE:
            # the last step went too far: the rows are no straight lines over its length
            model = model.at(0.5 * (model.vector + kept.problem.about.vector))
            continue
        fitted = unbiased_fit(problem, model)
        kept = FitOfAll(problem, fitted, _before(problem.runs), not np.any(_in_stds(fitted, model.vector) > SETTLED))
        if not kept.settled:
            kept = replace(kept, settled=_is_straight(kept, rows, rows_of, jobs))
        if kept.settled:
            break
        model = fitted.model
    assert kept is not None
    return kept


def _kept_rows(
    rows_of: Callable[[int], PartRows | None], name: str, model: Model, count: int, jobs: int, keep: Kept
) -> Iterator[PartRows | None]:
    """`rows_of` of each part at `model`, by `jobs` processes, or as `keep` has it; what is computed is kept."""
    known = {number: keep.read_arrays(f"{name}_{number}", partial(_restored, model)) for number in range(count)}
    new = [number for number, found in known.items() if found is None]
    computed = map_forked(lambda index: rows_of(new[index]), len(new), jobs)
    for number, before in known.items():
        found = before or next(computed)
        if before is None and found is not None:
            keep.write_arrays(f"{name}_{number}", vars(found) | {"about": model.vector})
        yield found


def _restored(model: Model, arrays: Mapping[str, Array]) -> PartRows:
    """The rows that were kept; raises `ValueError` where they are of another model."""
    if not np.array_equal(arrays["about"], model.vector):
        raise ValueError("rows of another model")
    plain: dict[str, Any] = {own.name: arrays[own.name] for own in fields(PartRows)}
    windows, rows = (int(size) for size in plain["shape"])
    plain |= {"name": str(plain["name"]), "shape": (windows, rows), "penalty": float(plain["penalty"])}
    return PartRows(**plain | {"noisy": bool(plain["noisy"])})


def _in_stds(fitted: Fit, vector: Array) -> Array:
    """(n + k,) how far each parameter is from `vector`, in standard deviations."""
    return np.asarray(np.abs(fitted.model.vector - vector) / np.maximum(fitted.std, np.finfo(float).tiny))


def _is_straight(
    found: FitOfAll,
    rows: Sequence[PartRows | None],
    rows_of: Callable[[int, Model], PartRows | None],
    jobs: int = 1,
) -> bool:
    """Whether the gradient at the fit is as the rows' slopes before the step predict, so that another step is small.

    That of some parts, by `jobs` processes, in proportion, and what it moves by the covariance.
    """
    model = found.fitted.model
    step = model.vector - found.problem.about.vector
    usable = [k for k, own in enumerate(rows) if own is not None]
    change, count = np.zeros(len(step)), 0
    checked = sorted({usable[round(at)] for at in np.linspace(0, len(usable) - 1, min(CHECKED, len(usable)))})
    computed = map_forked(lambda index: rows_of(checked[index], model), len(checked), jobs)
    for before, after in zip((rows[k] for k in checked), computed, strict=True):
        if before is None or after is None or before.shape != after.shape:
            continue
        change += after.jacobian.T @ after.residual - before.jacobian.T @ (before.residual + before.jacobian @ step)
        count += before.rows
    moved = found.fitted.covariance @ change * (sum(run.rows for run in found.problem.runs) / max(count, 1))
    return bool(np.all(np.abs(moved) < SETTLED * found.fitted.std))


def _objective(problem: AllRows, model: Model) -> float:
    """χ² at the model at which the rows were computed, with penalties and priors."""
    residual = problem.residual(model)
    return float(residual @ residual) + sum(run.penalty for run in problem.runs)


def _before(rows: Sequence[PartRows]) -> float:
    return float(sum(run.without @ run.without for run in rows) / sum(run.rows for run in rows))
