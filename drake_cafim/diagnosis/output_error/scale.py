"""How well simulations tell the scale of all efforts at a joint: of its servo, its friction and its rotor."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.problem import (
    REFIT_STEPS,
    OutputErrorProblem,
    SimulationFit,
    at_joint,
    number_name,
)
from drake_cafim.typing import Array

LEAST_GAIN = 0.1
"""Decrease of −2 ln p by another scale below which it is not taken: a third of the scale's standard deviation."""
SIZES = (0.05, 0.15, 0.4, 0.8)
"""Changes, up and down, of the logarithm of a joint's efforts at which simulations are compared."""
PASSES = 3
"""Simulations at each change, between which all other numbers adapt to first order."""


@dataclass(frozen=True)
class ScaleProfile:
    """By joint, what changes of the logarithm of the scale of all its efforts do, all other numbers adapted.

    Where neither inertia nor gravity fixes the scale, simulations hardly depend on it, and slopes by differences, rough
    as simulations with friction are, seem to know it all the same. `std` (c,) is the distance from the best scale at
    which −2 ln p is higher by one, the widest of those that several scales imply, since what is rough rises too much
    over small distances; `along` (m,) of each joint the change of its numbers by one of ln scale, at about that.
    """

    std: Array
    along: tuple[Array, ...]
    lowered: Array
    """(c,) by how much −2 ln p is less at the best scale than at the fit's."""
    best: Array
    """(n + k,) the numbers there."""


def fit_scale(problem: OutputErrorProblem, found: SimulationFit) -> tuple[SimulationFit, ScaleProfile]:
    """The fit, or one from another scale of the efforts at a joint that has a lower cost there, and its profile."""
    profile = profile_scale(problem, found)
    if np.all(profile.lowered < LEAST_GAIN):
        return found, profile
    again = problem.fit(found.model.at(profile.best), steps=REFIT_STEPS)
    return again if np.sum(again.costs) < np.sum(found.costs) else found, profile


def profile_scale(problem: OutputErrorProblem, found: SimulationFit) -> ScaleProfile:
    """The profile about a fit."""
    vector, joints = found.model.vector, range(len(problem.joints))
    numbers = [np.array(list(own.values()), dtype=np.int64) for own in problem.numbers(found.model)]
    scaled = [_scaled(problem, found.model, j) for j in joints]
    every = np.array(sorted({i for own in scaled for i in own}), dtype=np.int64)

    def followed(sign: float) -> tuple[Array, Array]:
        """(K, c) the least −2 ln p of each joint at the changes of one sign, and (K, n + k) the numbers there."""
        found_costs, found_numbers, last, slope = list[Array](), list[Array](), 0.0, np.zeros(len(vector))
        slope[every], best = vector[every], vector
        for size in SIZES:
            # from what was found at the last change, as far as that goes on
            x, least = best + sign * (size - last) * slope, np.full(len(joints), np.inf)
            x[every] = best[every] * np.exp(sign * (size - last))
            best = x.copy()
            for _ in range(PASSES):
                errors, x = problem.simulated_within_bounds(found.model, x)
                costs = problem.costs(errors, found.model, x)
                for j, own in enumerate(numbers):
                    if costs[j] < least[j]:
                        least[j], best[own] = costs[j], x[own]
                    adapting = own[[i != scaled[j][0] for i in own]]
                    J = found.equations[j].J[:, np.isin(own, adapting)]
                    x[adapting] -= np.linalg.lstsq(J, errors[:, j], rcond=None)[0]
            last, slope = size, sign * (best - vector) / size
            found_costs.append(least)
            found_numbers.append(best.copy())
        return np.stack(found_costs), np.stack(found_numbers)

    (below, under), (above, over) = problem.for_each(followed, (-1.0, 1.0))
    changes = np.array([*(-size for size in reversed(SIZES)), 0.0, *SIZES])
    costs, at = np.stack([*below[::-1], found.costs, *above]), np.stack([*under[::-1], vector, *over])
    std, along, best = np.zeros(len(joints)), [], vector.copy()
    for j, own in enumerate(numbers):
        least = int(np.argmin(costs[:, j]))
        best[own] = at[least, own]
        apart = np.delete(changes - changes[least], least)
        # a rise by Δ at a distance c is a standard deviation of c/√Δ; without a rise, of c at least
        std[j] = np.max(np.abs(apart) / np.sqrt(np.maximum(np.delete(costs[:, j] - costs[least, j], least), 1.0)))
        k = int(np.argmin(np.abs(np.log(np.abs(apart) / std[j]))))
        along.append((np.delete(at, least, axis=0)[k, own] - best[own]) / apart[k])
    return ScaleProfile(std, tuple(along), found.costs - np.min(costs, axis=0), best)


def _scaled(problem: OutputErrorProblem, model: Model, joint: int) -> list[int]:
    """The indices in a model's vector of a joint's numbers that are an effort over something, or an inertia."""
    own, name = problem.numbers(model)[joint], problem.joints[joint]
    found = [i for key, i in own.items() if key.startswith(".servo_")]
    for effect in model.effects:
        if at_joint(effect.at, name):
            units = [(s, effect.unit(s, problem.scene.tree)) for s in effect.strengths if s.amplitude]
            found += [own[number_name(effect, s.name)] for s, unit in units if unit.startswith(("N", "kg"))]
    return found
