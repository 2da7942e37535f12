"""Evidence for one explanation against another, along a motion that is planned or was made.

Every number of a model is measured in units of what is known of it beforehand: unknowns from their priors, strengths
from no effect in units of the size at which engineers meet them. In these coordinates x the prior is a unit normal, and
with whitened rows z(x), Jacobian J and F = JᵀJ, Laplace's approximation of the evidence is

    ln p(y | model) = −½ (|z(x̂)|² + |x̂|²) − ½ ln det(I + F) + a constant that all models share,

exact where the rows are linear (MacKay, Information Theory, 2003, ch. 28).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.effect import Strength
from drake_cafim.typing import Array

Rows: TypeAlias = Callable[[Array], Array]
SMALLEST = 1e-4
"""Of a coordinate that is the inverse of a strength: no effect at all would be a strength without end."""
STEPS, DAMPINGS = 25, 6
CONVERGED = 1e-3
"""Of |z|² + |x|², which a step is expected to gain, or did."""


def coordinate(strength: Strength, value: float) -> float:
    """The strength in units of its typical size, zero where it is absent."""
    return strength.typical / value if strength.inverse else (value - strength.nominal) / strength.typical


def strength_at(strength: Strength, x: float) -> float:
    """The strength at the coordinate `x`, within its bounds."""
    value = strength.typical / max(x, SMALLEST) if strength.inverse else strength.nominal + strength.typical * x
    return float(np.clip(value, strength.lower, strength.upper))


def coordinates(problem: WeakProblem, model: Model) -> Array:
    """(k,) of unknowns, then strengths."""
    priors = problem.scene.priors
    unknown = (model.unknown - priors.mean) / priors.std
    strengths = [coordinate(s, v) for e in model.effects for s, v in zip(e.strengths, e.vector.tolist(), strict=True)]
    return np.concatenate([unknown, np.array(strengths, dtype=float)])


def model_at(problem: WeakProblem, model: Model, x: Array) -> Model:
    """The model with its numbers at the coordinates `x` (k,), within their bounds."""
    priors, n = problem.scene.priors, len(model.unknown)
    unknown = priors.clip(priors.mean + priors.std * x[:n])
    effects, start = [], n
    for effect in model.effects:
        own = x[start : start + len(effect.strengths)].tolist()
        effects.append(
            effect.with_values({s.name: strength_at(s, c) for s, c in zip(effect.strengths, own, strict=True)})
        )
        start += len(effect.strengths)
    return Model(unknown, tuple(effects))


def slopes(problem: WeakProblem, model: Model) -> Array:
    """Whitened data rows (R, k) by the coordinates."""
    per_number = [np.asarray(problem.scene.priors.std, dtype=float)]
    for effect in model.effects:
        values = zip(effect.strengths, effect.vector.tolist(), strict=True)
        per_number.append(np.array([-(v**2) / s.typical if s.inverse else s.typical for s, v in values]))
    return np.asarray(problem.jacobian(model)[: problem.rows] * np.concatenate(per_number), dtype=float)


@dataclass(frozen=True)
class Explained:
    """A model at its most probable numbers `x` (k,): `rows` z (R,) and their `slopes` J (R, k) there."""

    model: Model
    x: Array
    rows: Array
    slopes: Array

    @property
    def misfit(self) -> float:
        """|z|² + |x|²."""
        return float(self.rows @ self.rows + self.x @ self.x)

    @property
    def information(self) -> Array:
        """F (k, k) in coordinates."""
        return np.asarray(self.slopes.T @ self.slopes)

    @property
    def log_evidence(self) -> float:
        """Up to the constant that models of the same rows share."""
        return -0.5 * (self.misfit + self.log_volume)

    @property
    def log_volume(self) -> float:
        """ln det(I + F): how much narrower the numbers are known after than before."""
        return float(np.linalg.slogdet(np.eye(len(self.information)) + self.information)[1])


def explain(
    problem: WeakProblem,
    model: Model,
    instead: Array | float = 0.0,
    *,
    rows: int | None = None,
    steps: int = STEPS,
    weight: float = 1.0,
) -> Explained:
    """The most probable numbers of `model` near those that it has, by damped Gauss–Newton.

    `instead` (R,) is taken off the rows: the data are then those of which a model with these rows would be true. Only
    the first `rows` count, where given, and all of them `weight` times.
    """
    count = problem.rows if rows is None else rows
    here = looked(problem, model)
    start = replace(here, rows=weight * (here.rows - instead)[:count], slopes=weight * here.slopes[:count])
    return _improved(problem, start, instead, steps=steps, weight=weight)


def looked(problem: WeakProblem, model: Model) -> Explained:
    """The model at the numbers that it has, whether or not they are its best."""
    rows = problem.residual(model)[: problem.rows]
    return Explained(model, coordinates(problem, model), rows, slopes(problem, model))


def _improved(
    problem: WeakProblem, here: Explained, instead: Array | float, *, steps: int, weight: float = 1.0
) -> Explained:
    """Nearer the most probable numbers, as many rows of the data as `here` has being known."""
    count = len(here.rows)
    damping = 1e-6
    for _ in range(steps):
        information, gradient = np.eye(len(here.x)) + here.information, here.slopes.T @ here.rows + here.x
        if gradient @ np.linalg.solve(information, gradient) < CONVERGED:
            break
        gained = 0.0
        for _ in range(DAMPINGS):
            step = -np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
            trial = model_at(problem, here.model, here.x + step)
            reached = coordinates(problem, trial)
            rows = weight * (problem.residual(trial)[: problem.rows] - instead)[:count]
            gained = here.misfit - float(rows @ rows + reached @ reached)
            if np.isfinite(gained) and gained >= 0.0:
                here = Explained(trial, reached, rows, weight * slopes(problem, trial)[:count])
                damping = max(0.1 * damping, 1e-9)
                break
            damping = max(10.0 * damping, 1e-3)
        if not gained > CONVERGED:
            break
    return here


@dataclass(frozen=True)
class Course:
    """Sums of JᵀJ (W, k, k), Jᵀz (W, k) and z·z (W,) up to the end of each window, z being the rows at x = 0.

    To first order they say all that a motion's rows, or as many whole motions as were added up before it, say of a
    model.
    """

    information: Array
    slope: Array
    square: Array

    @classmethod
    def of(cls, problem: WeakProblem, explained: Explained, rows: Array | None = None) -> "Course":
        """The course about explained numbers; `rows` (R,), if given, are the whitened rows there instead of its own."""
        here = explained.rows if rows is None else rows
        count = problem.runs[0].weak.rows_per_window
        J = explained.slopes.reshape(-1, count, len(explained.x))
        z = (here - explained.slopes @ explained.x).reshape(-1, count)
        Jt = J.transpose(0, 2, 1)
        information, slope = Jt @ J, (Jt @ z[..., None])[..., 0]
        return cls(np.cumsum(information, axis=0), np.cumsum(slope, axis=0), np.cumsum(np.sum(z**2, axis=1)))

    def after(self, before: "Course", times: float = 1.0) -> "Course":
        """This course `times` after the end of another."""
        information, slope, square = before.information[-1], before.slope[-1], before.square[-1]
        return Course(self.information + times * information, self.slope + times * slope, self.square + times * square)

    def repeated(self, times: Array) -> "Course":
        """What is said after the whole motion was run each of `times` (K,), instead of by window."""
        information, slope = (np.multiply.outer(times, one[-1]) for one in (self.information, self.slope))
        return Course(information, slope, times * self.square[-1])

    @property
    def misfit(self) -> Array:
        """|z|² + |x|² (W,) at the most probable numbers."""
        best = np.linalg.solve(self._posterior, self.slope[..., None])[..., 0]
        return np.asarray(self.square - np.einsum("wi,wi->w", self.slope, best))

    @property
    def log_evidence(self) -> Array:
        """(W,) up to what all models share."""
        return np.asarray(-0.5 * (self.misfit + np.linalg.slogdet(self._posterior)[1]))

    @property
    def _posterior(self) -> Array:
        return np.asarray(np.eye(self.slope.shape[-1]) + self.information)

    @property
    def fitted(self) -> Array:
        """tr F (I + F)⁻¹ (W,): how many numbers the rows determine, each of which takes one from |noise|²."""
        return np.asarray(self.slope.shape[-1] - np.trace(np.linalg.inv(self._posterior), axis1=1, axis2=2))


def expected(problem: WeakProblem, truth: Explained, rival: Explained, *, steps: int = 5) -> tuple[Course, Course]:
    """The courses of both models along a planned motion, of the data that `truth` makes without noise.

    Both were `looked` at on it. `problem` holds the motion as the nominal model makes it: a model's rows on the data of
    `truth` are, to first order in the data, its rows there less those of `truth`.
    """
    best = _improved(problem, replace(rival, rows=rival.rows - truth.rows), truth.rows, steps=steps)
    return Course.of(problem, truth, np.zeros_like(truth.rows)), Course.of(problem, best)


def expected_log_odds(own: Course, other: Course) -> Array:
    """E ln p(y | truth's model)/p(y | rival's model) (W,) over the noise, up to each window's end.

    Half the non-centrality of the best-fitting rival (Atkinson, Fedorov, Biometrika 62(1), 1975), with unknowns and the
    rival's own strengths fitted, and what each model pays for numbers that it must determine.
    """
    return np.asarray(own.log_evidence - other.log_evidence + 0.5 * (own.fitted - other.fitted))
