"""Bayesian evidence of one explanation against another, along a planned or an executed motion.

The parameters of a model are scaled by their priors: unknowns as (value − mean)/std, strengths as the deviation from no
effect in units of their typical size. In these coordinates x the prior is a unit normal, and with whitened residual
z(x), Jacobian J and F = JᵀJ, Laplace's approximation of the evidence is

    ln p(y | model) = −½ (|z(x̂)|² + |x̂|²) − ½ ln det(I + F) + a constant that all models share,

exact where the rows are linear (MacKay, Information Theory, 2003, ch. 28).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.effects.effect import Strength
from drake_cafim.typing import Array

Rows: TypeAlias = Callable[[Array], Array]
SMALLEST = 1e-4
"""Smallest coordinate of an inverse strength: zero, no effect, would be an infinite strength."""
STEPS, DAMPINGS = 25, 6
"""Largest numbers of Gauss–Newton steps, and of increases of the damping within a step."""
CONVERGED = 1e-3
"""Convergence threshold: expected or actual decrease of |z|² + |x|² in a step."""


def coordinate(strength: Strength, value: float) -> float:
    """The scaled coordinate of a strength's value, zero where the effect is absent."""
    return strength.typical / value if strength.inverse else (value - strength.nominal) / strength.typical


def strength_at(strength: Strength, x: float) -> float:
    """The strength at the coordinate `x`, within its bounds."""
    value = strength.typical / max(x, SMALLEST) if strength.inverse else strength.nominal + strength.typical * x
    return float(np.clip(value, strength.lower, strength.upper))


def coordinates(problem: WeakProblem, model: Model) -> Array:
    """The scaled coordinates (k,) of the model's unknowns, then of its effects' strengths."""
    priors = problem.scene.priors
    unknown = (model.unknown - priors.mean) / priors.std
    strengths = [coordinate(s, v) for e in model.effects for s, v in zip(e.strengths, e.vector.tolist(), strict=True)]
    return np.concatenate([unknown, np.array(strengths, dtype=float)])


def model_at(problem: WeakProblem, model: Model, x: Array) -> Model:
    """The model with its parameters at the coordinates `x` (k,), clipped to their bounds."""
    priors, n = problem.scene.priors, len(model.unknown)
    unknown = priors.clip(priors.mean + priors.std * x[:n])
    effects, start = [], n
    for effect in model.effects:
        scaled = x[start : start + len(effect.strengths)].tolist()
        effects.append(
            effect.with_values({s.name: strength_at(s, c) for s, c in zip(effect.strengths, scaled, strict=True)})
        )
        start += len(effect.strengths)
    return Model(unknown, tuple(effects))


def slopes(problem: WeakProblem, model: Model) -> Array:
    """The Jacobian ∂z/∂x (R, k) of the whitened data rows with respect to the coordinates."""
    per_number = [np.asarray(problem.scene.priors.std, dtype=float)]
    for effect in model.effects:
        values = zip(effect.strengths, effect.vector.tolist(), strict=True)
        per_number.append(np.array([-(v**2) / s.typical if s.inverse else s.typical for s, v in values]))
    return np.asarray(problem.jacobian(model)[: problem.rows] * np.concatenate(per_number), dtype=float)


@dataclass(frozen=True)
class Explained:
    """A model at coordinates `x` (k,), as a rule its posterior mode: whitened residual `rows` z (R,), Jacobian
    `slopes` J (R, k).
    """

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
        """ln p(y | model) up to the constant that all models of the same rows share."""
        return -0.5 * (self.misfit + self.log_volume)

    @property
    def log_volume(self) -> float:
        """ln det(I + F): −2 ln of the ratio of posterior to prior volume."""
        return float(np.linalg.slogdet(np.eye(len(self.information)) + self.information)[1])


def explain(
    problem: WeakProblem,
    model: Model,
    instead: Array | float = 0.0,
    *,
    rows: int | None = None,
    weight: float = 1.0,
) -> Explained:
    """The posterior mode of `model` near its present values, by damped Gauss–Newton.

    `instead` (R,) is subtracted from the residual: the data are then those that a model with this residual predicts.
    Only the first `rows` are used, where given, and the residual is multiplied by `weight`.
    """
    count = problem.rows if rows is None else rows
    here = linearise(problem, model)
    start = replace(here, rows=weight * (here.rows - instead)[:count], slopes=weight * here.slopes[:count])
    return _improved(problem, start, instead, weight=weight)


def linearise(problem: WeakProblem, model: Model) -> Explained:
    """The residual and the Jacobian of `model` at its present values."""
    rows = problem.residual(model)[: problem.rows]
    return Explained(model, coordinates(problem, model), rows, slopes(problem, model))


def _improved(problem: WeakProblem, here: Explained, instead: Array | float, weight: float = 1.0) -> Explained:
    """`here` improved by up to `STEPS` damped Gauss–Newton steps, with as many rows as `here` has."""
    count = len(here.rows)
    damping = 1e-6
    for _ in range(STEPS):
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
    """Sums of JᵀJ (W, k, k), Jᵀz (W, k) and z·z (W,) up to the end of each window, with z the residual at x = 0.

    For rows linear in x they are sufficient statistics of the data so far, from one motion or from several.
    """

    information: Array
    slope: Array
    square: Array

    @classmethod
    def of(cls, problem: WeakProblem, explained: Explained, rows: Array | None = None) -> "Course":
        """The course linearized at `explained`; `rows` (R,) replace its whitened residual, where given."""
        here = explained.rows if rows is None else rows
        count = problem.runs[0].weak.rows_per_window
        J = explained.slopes.reshape(-1, count, len(explained.x))
        z = (here - explained.slopes @ explained.x).reshape(-1, count)
        Jt = J.transpose(0, 2, 1)
        information, slope = Jt @ J, (Jt @ z[..., None])[..., 0]
        return cls(np.cumsum(information, axis=0), np.cumsum(slope, axis=0), np.cumsum(np.sum(z**2, axis=1)))

    def after(self, before: "Course", times: float = 1.0) -> "Course":
        """This course preceded by `times` repetitions of the whole of another."""
        information, slope, square = before.information[-1], before.slope[-1], before.square[-1]
        return Course(self.information + times * information, self.slope + times * slope, self.square + times * square)

    def repeated(self, times: Array) -> "Course":
        """The course whose entries are the sums after the whole motion was run `times` (K,), instead of by window."""
        information, slope = (np.multiply.outer(times, sums[-1]) for sums in (self.information, self.slope))
        return Course(information, slope, times * self.square[-1])

    @property
    def misfit(self) -> Array:
        """|z|² + |x|² (W,) at the posterior mode."""
        best = np.linalg.solve(self._posterior, self.slope[..., None])[..., 0]
        return np.asarray(self.square - np.einsum("wi,wi->w", self.slope, best))

    @property
    def log_evidence(self) -> Array:
        """ln p(y | model) (W,), up to the constant that all models share."""
        return np.asarray(-0.5 * (self.misfit + np.linalg.slogdet(self._posterior)[1]))

    @property
    def _posterior(self) -> Array:
        return np.asarray(np.eye(self.slope.shape[-1]) + self.information)

    @property
    def fitted(self) -> Array:
        """tr F (I + F)⁻¹ (W,): effective number of fitted parameters, each of which reduces E|noise|² by one."""
        return np.asarray(self.slope.shape[-1] - np.trace(np.linalg.inv(self._posterior), axis1=1, axis2=2))


def expected(problem: WeakProblem, truth: Explained, rival: Explained) -> tuple[Course, Course]:
    """The courses of both models along a planned motion, for the noiseless data that `truth` predicts.

    Both are results of `linearise` on `problem`, whose data are the nominal model's predictions: to first order in the
    data, a model's residual on the data of `truth` is its residual on `problem` minus that of `truth`.
    """
    best = _improved(problem, replace(rival, rows=rival.rows - truth.rows), truth.rows)
    return Course.of(problem, truth, np.zeros_like(truth.rows)), Course.of(problem, best)


def expected_log_odds(truth: Course, rival: Course) -> Array:
    """E ln p(y | truth's model)/p(y | rival's model) (W,) over the noise, up to each window's end.

    Half the non-centrality of the best-fitting rival (Atkinson, Fedorov, Biometrika 62(1), 1975), with unknowns and the
    rival's strengths fitted, and the Occam factors of both models.
    """
    return np.asarray(truth.log_evidence - rival.log_evidence + 0.5 * (truth.fitted - rival.fitted))
