"""Shapes of laws, as the width over which dry friction changes its sign, chosen by errors of simulations."""

from collections.abc import Collection, Iterator
from itertools import zip_longest
from typing import Any

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.output_error.moves import with_others, with_values_of
from drake_cafim.diagnosis.output_error.problem import REFIT_STEPS, ErrorProblem, SimulationFit, at_joint
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import SLIP_VELOCITY

STICKING = SLIP_VELOCITY.grid[0] / 3.0
"""rad/s (m/s): a width so narrow that a joint sticks, which the equations of motion could not tell from the grid's."""


def fit_shapes(
    problem: ErrorProblem[Any], best: SimulationFit, steps: int = 0, among: Collection[Key] | None = None
) -> SimulationFit:
    """`best` with other shapes of its laws, or of those `among` them, where a joint's cost is then less.

    Each on a law's grid is tried with the numbers as they are or, with `steps`, after so many chord steps.
    """
    model = best.model
    options = [
        [
            other
            for effect in model.effects
            if at_joint(effect.at, joint) and not effect.shapes_about_values and (among is None or effect.key in among)
            for other in _other_shapes(effect)
        ]
        for joint in problem.joints
    ]
    lead: list[tuple[float, Effect | None]] = [(float(cost), None) for cost in best.costs]
    tried = list(zip_longest(*options))
    slopes = best.slopes_without(())
    trials = problem.for_each(lambda others: problem.fit(with_others(model, others), slopes, steps), tried)
    for others, trial in zip(tried, trials, strict=True):
        for j, other in enumerate(others):
            if other is not None and trial.costs[j] < lead[j][0]:
                lead[j] = (float(trial.costs[j]), with_values_of(trial.model, other))
    chosen = [other for _, other in lead]
    if not any(chosen):
        return best
    fitted = problem.fit(with_others(model, chosen), slopes, REFIT_STEPS)
    back = [None if cost < old else other for cost, old, other in zip(fitted.costs, best.costs, chosen, strict=True)]
    if not any(back):
        return fitted
    return problem.fit(with_others(fitted.model, [with_values_of(model, e) if e else None for e in back]), slopes)


def _other_shapes(effect: Effect) -> Iterator[Effect]:
    """The effect with the other shapes of its grid, and as one that sticks."""
    yield from effect.restarts_under_servo()
    if any(shape is SLIP_VELOCITY for shape in effect.shapes) and effect.values.get(SLIP_VELOCITY.name) != STICKING:
        yield type(effect)(effect.at, {**effect.values, SLIP_VELOCITY.name: STICKING})
