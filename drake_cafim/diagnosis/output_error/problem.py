"""Maximum a posteriori fits of servos' unknowns and of effects at joints to output errors, all joints at once.

The equations of a joint that a servo drives, kp (cmd − q) − kv v + … = 0, can be multiplied by any number where neither
inertia nor gravity fixes their scale. Where physics is missing, a stiffness of nearly zero then satisfies them best.
The error of a simulation over a second has no such scale (Ljung, System Identification, 1999, §4.3). Of each joint j,

    −2 ln p_j = −2 ln p(q_j − q̂_j) + Σ (x − μ)²/σ²,

with the likelihood of `ErrorLikelihood`, is minimised over its numbers x: the unknowns of its servo and its encoder,
and the strengths of effects there.

What moves another joint hardly moves this one, so that each joint has its own Jacobian, and one number of every joint
is moved in one simulation.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.errors import OutputErrors, left_out_parts
from drake_cafim.diagnosis.output_error.likelihood import ErrorLikelihood
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.effect import Effect
from drake_cafim.parallel.forked import map_forked
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.servos import SERVO_PARAMETERS
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices

MOST_STEPS = 12
"""Most Gauss-Newton steps."""
REFIT_STEPS = 4
"""Most steps of a fit that begins near its end."""
LEAST_DECREASE = 1.0
"""Decrease of −2 ln p of every joint by a step below which a fit ends: it then moves no number by more than its std."""
RELATIVE_STEP = 0.02
"""Step of the differences, over the number or its size, the larger of the two: simulations with friction are rough."""
MOST_DAMPING = 1e4
"""Damping (Levenberg, Marquardt) beyond which no step is looked for."""
WIDE = 10.0
"""Prior standard deviation of a strength, over its size: so wide that it keeps apart only what recordings do not."""

Names = tuple[str, ...]
T = TypeVar("T")
U = TypeVar("U")


@dataclass(frozen=True)
class NormalEquations:
    """Of one joint: the slopes `J` (S, m) of its `errors` (S,) by its numbers, and the priors of these."""

    J: Array
    errors: Array
    block: np.ndarray[tuple[int], np.dtype[np.int64]]
    weight: float
    """What a squared error counts."""
    precision: Array
    """(m,) σ⁻² of the priors."""
    from_mean: Array
    """(m,) x − μ."""

    @property
    def information(self) -> Array:
        """(m, m) w JᵀJ + diag σ⁻²."""
        return np.asarray(self.weight * self.J.T @ self.J + np.diag(self.precision), dtype=float)

    @property
    def gradient(self) -> Array:
        """(m,) w Jᵀe + σ⁻² (x − μ)."""
        return np.asarray(self.weight * self.J.T @ self.errors + self.precision * self.from_mean, dtype=float)

    def step(self, damping: float) -> Array:
        """(m,) what is to be subtracted from the numbers."""
        H = self.information
        return np.asarray(np.linalg.solve(H + damping * np.diag(np.diag(H)), self.gradient), dtype=float)

    @property
    def covariance(self) -> Array:
        """(m, m) H⁻¹, or H⁻¹ Σ g_b g_bᵀ H⁻¹ with the gradients g_b of blocks b, the larger variances of the two.

        The correlations are those of H⁻¹.
        """
        inverse = np.linalg.inv(self.information)
        blocks = np.unique(self.block)
        g = self.weight * np.stack([self.J[self.block == b].T @ self.errors[self.block == b] for b in blocks])
        g = g - np.mean(g, axis=0)
        spread = g.T @ g * len(g) / max(1, len(g) - 1)
        own = np.diag(inverse)
        wider = np.sqrt(np.maximum(np.diag(inverse @ spread @ inverse), own) / own)
        return np.asarray(inverse * np.outer(wider, wider), dtype=float)

    @property
    def std(self) -> Array:
        """(m,) standard deviations of the numbers."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=float)

    def left_out(self) -> Array:
        """(b,) ln mean squared error of each part by the numbers that the other parts imply, to first order."""
        g, found, parts = self.gradient, [], left_out_parts(self.block)
        for b in np.unique(parts):
            own = parts == b
            J, e = self.J[own], self.errors[own]
            without = self.weight * self.J[~own].T @ self.J[~own] + np.diag(self.precision)
            change = np.linalg.solve(without, g - self.weight * J.T @ e)
            found.append(np.log(max(float(np.mean((e - J @ change) ** 2)), 1e-30)))
        return np.array(found)


@dataclass(frozen=True)
class SimulationFit:
    """A fitted `model`, its errors (S, c), and by joint the names of its numbers and their normal equations."""

    model: Model
    errors: Array
    names: tuple[Names, ...]
    equations: tuple[NormalEquations, ...]
    costs: Array
    """(c,) −2 ln p of each joint."""

    def slopes_without(self, effects: Sequence[Effect]) -> tuple[Array, ...]:
        """By joint, the slopes (S, m) by the numbers that are no strengths of these `effects`."""
        dropped = {number_name(effect, strength.name) for effect in effects for strength in effect.strengths}
        return tuple(
            own.J[:, [name not in dropped for name in names]]
            for names, own in zip(self.names, self.equations, strict=True)
        )


def number_name(effect: Effect, strength: str) -> str:
    """The name of an effect's strength among the numbers of its joint."""
    return f"{effect.name}@{effect.at}.{strength}"


class Errors(Protocol):
    """Errors (S, c) that models make at `joints` (c), in the recordings `forms`."""

    forms: tuple[WeakForm, ...]
    joints: tuple[str, ...]
    block: Indices
    """(S,) the block of a recording that each error is in, numbered through."""
    likelihood: ErrorLikelihood

    def of(self, physics: Physics) -> Array:
        """The errors (S, c) by `physics`."""
        ...

    def count(self, found: Array) -> None:
        """The likelihood is that of errors as independent as `found` (S, c) from now on."""
        ...

    def finely(self) -> Self:
        """The same errors, computed as finely as close decisions need, and counted apart."""
        ...


E = TypeVar("E", bound=Errors)


@dataclass
class ErrorProblem(Generic[E]):
    """Fits of a scene's models to errors at its joints, by `jobs` processes.

    `sizes` are those of effects' strengths, by name of the number.
    """

    scene: Scene
    errors: E
    sizes: dict[str, float] = field(default_factory=dict)
    jobs: int = 1

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are fitted."""
        return self.errors.joints

    def errors_of(self, model: Model) -> Array:
        """Errors (S, c) by a model."""
        return self.errors.of(model.physics(self.scene))

    def for_each(self, function: Callable[[T], U], items: Sequence[T]) -> list[U]:
        """The function's result of each item, by copies of this process: what it changes in memory may be lost."""
        if len(items) < 2:
            return list(map(function, items))
        # a copy makes no copies
        jobs, self.jobs = self.jobs, 1
        try:
            return list(map_forked(lambda k: function(items[k]), len(items), jobs))
        finally:
            self.jobs = jobs

    @contextmanager
    def simulating(self, errors: E) -> Iterator[None]:
        """Within it, models are simulated as these `errors` are."""
        usual, self.errors = self.errors, errors
        try:
            yield
        finally:
            self.errors = usual

    def counted(self, fitted: SimulationFit) -> SimulationFit:
        """The fit with its costs by the number of independent errors that it leaves, as all costs from now on."""
        self.errors.count(fitted.errors)
        return self.fit(fitted.model, fitted.slopes_without(()), steps=0)

    def sized(self, effect: Effect) -> Effect:
        """The effect; its values are the sizes of its strengths from now on."""
        for strength, value in zip(effect.strengths, effect.vector, strict=True):
            size = abs(value) if strength.inverse else abs(value - strength.nominal)
            self.sizes[number_name(effect, strength.name)] = size if size > 0.0 else strength.typical
        return effect

    def numbers(self, model: Model) -> list[dict[str, int]]:
        """By joint, the indices in the model's vector of the numbers that are fitted there, by name."""
        found: list[dict[str, int]] = []
        for joint in self.joints:
            own = {
                f"{unknown.effect or ''}.{unknown.parameter}": i
                for i, unknown in enumerate(self.scene.unknown)
                if (unknown.parameter in SERVO_PARAMETERS and unknown.at == joint)
                or (unknown.effect is not None and at_joint(unknown.at, joint))
            }
            i = len(model.unknown)
            for effect in model.effects:
                for strength in effect.strengths:
                    if at_joint(effect.at, joint):
                        own[number_name(effect, strength.name)] = i
                    i += 1
            found.append(own)
        return found

    def fit(self, model: Model, slopes: Sequence[Array] | None = None, steps: int = MOST_STEPS) -> SimulationFit:
        """The fit of a model from its own values, by damped Gauss-Newton steps (Levenberg, Marquardt).

        With `slopes` (S, m) of each joint these stay as they are (the chord method): a step then takes one simulation.
        """
        numbers, priors = self.numbers(model), self._priors(model)
        indices = [np.array(list(own.values()), dtype=np.int64) for own in numbers]
        found, vector = self.simulated_within_bounds(model, model.vector)
        here = self.costs(found, model, vector)
        J = slopes or self._slopes(model.at(vector), found, indices)
        damping = np.full(len(indices), 1e-2)
        for _ in range(steps):
            systems = self._systems(J, found, vector, indices, priors)
            taken = None
            while taken is None and np.any(damping < MOST_DAMPING):
                trial = vector.copy()
                for own, system, own_damping in zip(indices, systems, damping, strict=True):
                    trial[own] -= system.step(own_damping)
                after, trial = self.simulated_within_bounds(model, trial)
                # a joint whose own error grows stays where it is
                worse = self.costs(after, model, trial) >= here
                for own in (own for own, stays in zip(indices, worse, strict=True) if stays):
                    trial[own] = vector[own]
                if np.any(worse) and not np.all(worse):
                    after = self.errors_of(model.at(trial))
                taken = (trial, after) if np.sum(self.costs(after, model, trial)) < np.sum(here) else None
                damping = np.where(worse | (taken is None), damping * 10.0, np.maximum(damping / 10.0, 1e-4))
            if taken is None:
                break
            before, (vector, found) = here, taken
            here = self.costs(found, model, vector)
            if np.all(before - here < LEAST_DECREASE):
                break
            J = slopes or self._slopes(model.at(vector), found, indices)
        systems = self._systems(J, found, vector, indices, priors)
        return SimulationFit(model.at(vector), found, tuple(tuple(own) for own in numbers), tuple(systems), here)

    def simulated_within_bounds(self, model: Model, vector: Array) -> tuple[Array, Array]:
        """The errors (S, c) of a model with the numbers `vector` (n + k,), and these, each within its bounds."""
        vector = np.clip(vector, *self._bounds(model))
        return self.errors_of(model.at(vector)), vector

    def costs(self, errors: Array, model: Model, vector: Array) -> Array:
        """(c,) −2 ln p of each joint, its priors included, with errors (S, c) at the numbers `vector` (n + k,)."""
        mean, std = self._priors(model)
        own = [np.array(list(numbers.values()), dtype=np.int64) for numbers in self.numbers(model)]
        prior = [float(np.sum(((vector[at] - mean[at]) / std[at]) ** 2)) for at in own]
        return np.asarray(self.errors.likelihood.costs(errors) + np.array(prior), dtype=float)

    def fit_again(self, fitted: SimulationFit) -> SimulationFit:
        """The fit of errors that are simulated otherwise, under its own slopes."""
        return self.fit(fitted.model, fitted.slopes_without(()), REFIT_STEPS)

    def slopes_of(self, model: Model, found: Array, effects: Sequence[Effect]) -> list[Array]:
        """By joint (S, k), the derivatives of its errors by the strengths of these `effects` of the model alone."""
        names = {number_name(effect, strength.name) for effect in effects for strength in effect.strengths}
        own = [[i for name, i in numbers.items() if name in names] for numbers in self.numbers(model)]
        return self._slopes(model, found, [np.array(i, dtype=np.int64) for i in own])

    def indices_of(self, found: SimulationFit, joint: int, effect: Effect) -> list[int]:
        """The places of an effect's strengths among the numbers of a joint."""
        return [found.names[joint].index(number_name(effect, strength.name)) for strength in effect.strengths]

    def _slopes(
        self, model: Model, found: Array, indices: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]]
    ) -> list[Array]:
        """By joint (S, m), the derivatives of its errors by its numbers, one number of each joint at once."""
        (lower, upper), vector = self._bounds(model), model.vector
        step = RELATIVE_STEP * np.maximum(np.abs(vector), self._sizes(model))
        step = np.where(vector + step > upper, -step, step)
        slopes = [np.zeros((len(found), len(own))) for own in indices]
        trials = []
        for row in zip_longest(*indices):
            at = [i for i in row if i is not None]
            beside = vector.copy()
            beside[at] += step[at]
            trials.append(np.clip(beside, lower, upper))
        simulated = self.for_each(lambda beside: self.errors_of(model.at(beside)), trials)
        for k, (beside, after) in enumerate(zip(trials, simulated, strict=True)):
            change = after - found
            for j, own in enumerate(indices):
                if k < len(own) and beside[own[k]] != vector[own[k]]:
                    slopes[j][:, k] = change[:, j] / (beside[own[k]] - vector[own[k]])
        return slopes

    def _systems(
        self,
        slopes: Sequence[Array],
        found: Array,
        vector: Array,
        indices: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]],
        priors: tuple[Array, Array],
    ) -> list[NormalEquations]:
        return [
            NormalEquations(
                J,
                found[:, j],
                self.errors.block,
                self.errors.likelihood.weight(found[:, j], j),
                priors[1][own] ** -2.0,
                vector[own] - priors[0][own],
            )
            for j, (J, own) in enumerate(zip(slopes, indices, strict=True))
        ]

    def _bounds(self, model: Model) -> tuple[Array, Array]:
        """The least and largest values (n + k,); of unknowns above zero, a hundredth of the prior mean at least."""
        lower = [max(p.lower, 0.01 * p.mean) if p.lower == 0.0 else p.lower for p in self.scene.priors.free]
        upper = [p.upper for p in self.scene.priors.free]
        strengths = [strength for effect in model.effects for strength in effect.strengths]
        return (
            np.array([*lower, *(strength.lower for strength in strengths)]),
            np.array([*upper, *(strength.upper for strength in strengths)]),
        )

    def _sizes(self, model: Model) -> Array:
        """(n + k,) the priors' standard deviations of the unknowns, and the sizes of the strengths."""
        own = [
            self.sizes.get(number_name(effect, strength.name), strength.typical)
            for effect in model.effects
            for strength in effect.strengths
        ]
        return np.concatenate([self.scene.priors.std, own])

    def _priors(self, model: Model) -> tuple[Array, Array]:
        """Means and standard deviations (n + k,); a strength is absent, give or take `WIDE` times its size."""
        strengths = [(s, value) for e in model.effects for s, value in zip(e.strengths, e.vector, strict=True)]
        # one that is absent at infinity has no mean
        mean = [value if strength.inverse else strength.nominal for strength, value in strengths]
        sizes = self._sizes(model)
        n = len(model.unknown)
        return np.concatenate([self.scene.priors.mean, mean]), np.concatenate([sizes[:n], WIDE * sizes[n:]])


OutputErrorProblem = ErrorProblem[OutputErrors]
"""A problem whose errors are those of simulated positions."""


def at_joint(place: str, joint: str) -> bool:
    """Whether a place of an effect is the joint or its encoder."""
    return place in (joint, f"q.{joint}")
