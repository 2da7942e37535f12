"""Fits the shape parameters of a law, which are not strengths: as the width over which friction changes sign."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.beside import Beside
from drake_cafim.diagnosis.fit.evidence import gain_over_residual, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import SHAPE_CHI_SQUARE_RANGE
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import SLIP

FINER = (1.5, 1.15, 1.04)
"""Factors by which a shape parameter is then multiplied and divided, as long as χ² falls."""
FINEST = (*FINER, 1.01, 1.0025, 1.0006)
"""Those of a displacement over which friction builds up: all of a motion after a turn hangs on it."""


def fit_shapes(
    problem: SearchProblem,
    best: Fit,
    of: Iterable[Key] | None = None,
    tolerance: float = 0.0,
    own_noise: bool = True,
) -> Fit:
    """The fit with the best shape of each effect in turn: first from the effect's grid, then between its values.

    Of the effects `of` these keys only, if they are given. A change of χ² by `tolerance` does not matter, in units of
    the noise that remains; `own_noise` is as for `fit`.

    With a wrong width, a change of sign looks like a law that falls or rises near rest.
    """
    keys = best.model.keys if of is None else frozenset(of)
    for position, present in enumerate(best.model.effects):
        if present.key in keys:
            shapes = _Shapes(problem, position, tolerance, own_noise)
            best = shapes.best(best)
    return best


def fit_shape_beside(beside: Beside, found: Fit, tolerance: float) -> Fit:
    """The fit with the best shape of the effect at the position of `beside`, all other slopes kept."""
    return _Shapes(beside.problem, beside.position, tolerance, True, beside).best(found)


@dataclass(frozen=True)
class _Shapes:
    """The shapes of the effect at a `position`; what is fitted there is as for `fit_shapes`."""

    problem: SearchProblem
    position: int
    tolerance: float
    own_noise: bool
    beside: Beside | None = None
    """Where the slopes of all else are kept."""

    def best(self, best: Fit) -> Fit:
        """The fit with the best shape, from `best`.

        Friction that builds up over a displacement is a function of the path, no longer of the velocity: it takes the
        place of friction that jumps where χ² is lower by more than `SHAPE_CHI_SQUARE_RANGE`, each kind of row in units
        of what remains there: a misfit elsewhere is no evidence against it.
        """
        effect = best.model.effects[self.position]
        if not effect.slips:
            return self._over_grid(best)
        if SLIP.name in effect.values:
            jumping, built_up = self._fit(self._with_slip(best.model)), best
        else:
            jumping = built_up = self._over_grid(best)
        slips = [self._with_slip(built_up.model, slip).effects[self.position] for slip in effect.slips]
        built_up, _ = self._best_of(built_up, slips)
        if SLIP.name not in built_up.model.effects[self.position].values:
            return jumping
        built_up = self._refined(built_up, FINEST)
        gain = gain_over_residual(self.problem, jumping, built_up)
        return built_up if gain > SHAPE_CHI_SQUARE_RANGE else jumping

    def _with_slip(self, model: Model, slip: float | None = None) -> Model:
        """The `model` whose effect there builds up over a displacement `slip`, rad or m, or over none."""
        effect = model.effects[self.position]
        values = {name: value for name, value in effect.values.items() if name != SLIP.name}
        shaped = type(effect)(effect.at, values if slip is None else values | {SLIP.name: slip})
        return replace(model, effects=(*model.effects[: self.position], shaped, *model.effects[self.position + 1 :]))

    def _over_grid(self, best: Fit) -> Fit:
        """The fit with the best shape on the effect's grids, and between their values, from `best`."""
        first, before, worst = best.chi_square, np.inf, -np.inf
        while before - best.chi_square > SHAPE_CHI_SQUARE_RANGE * scale_of(best):
            before, effect = best.chi_square, best.model.effects[self.position]
            best, worst = self._best_of(best, effect.restarts())
            if not effect.shapes_about_values:
                # the grid does not depend on the values: it would be the same again
                break
        # χ² hardly depends on the shape: values between those of the grid cannot matter
        if max(first, worst) - best.chi_square < SHAPE_CHI_SQUARE_RANGE * scale_of(best):
            return best
        return self._refined(best)

    def _refined(self, best: Fit, ratios: Sequence[float] = FINER) -> Fit:
        """The fit with the best shape between the values of the effect's grids, from `best`."""
        for ratio in ratios:
            before = np.inf
            while best.chi_square < before - self.tolerance * scale_of(best):
                before = best.chi_square
                best, _ = self._best_of(best, best.model.effects[self.position].between_shapes(ratio))
        return best

    def _best_of(self, best: Fit, others: Iterable[Effect]) -> tuple[Fit, float]:
        """The best of the given fit and those with each of `others`, and the largest χ² of these.

        Where the rows are nearly linear in the strengths, χ² to first order selects the shape that is fitted.
        """
        base, at, worst = best.model, self.position, -np.inf
        trials = [replace(base, effects=(*base.effects[:at], it, *base.effects[at + 1 :])) for it in others]
        expected = self._expected(best, trials)
        if expected:
            worst = max(expected)
            trials = [trials[int(np.argmin(expected))]] if min(expected) < best.chi_square else []
        for model in trials:
            trial = self._fit(model)
            worst = max(worst, trial.chi_square)
            if trial.chi_square < best.chi_square:
                best = trial
        return best, worst

    def _fit(self, model: Model) -> Fit:
        if self.beside is not None:
            return self.beside.fit(model, self.tolerance)
        return fit(self.problem, model, tolerance=self.tolerance, own_noise=self.own_noise)

    def _expected(self, best: Fit, models: Sequence[Model]) -> list[float]:
        """χ² to first order of a fit started from each of `models`, whose effect has another shape than in `best`.

        Empty where the rows are not linear enough in the effect.
        """
        beside, found = self.beside, []
        for model in models:
            if not model.effects[self.position].all_but_linear:
                continue
            beside = beside or Beside.of(self.problem, best, self.position)
            columns = beside.columns(model)
            _, left = beside.step(model, beside.residual(model), columns)
            # what lags and unknown starts pay is theirs, and hardly changes with the shape of another law
            late = model.effects[self.position].late
            found.append(left + (self.problem.penalty(model, self.own_noise) if late else best.penalty))
        return found
