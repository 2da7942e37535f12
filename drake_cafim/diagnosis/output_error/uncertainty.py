"""Standard deviations of what is fitted to output errors: by curvature, the scale of efforts, and other unknowns."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.output_error.problem import OutputErrorProblem, SimulationFit, at_joint, number_name
from drake_cafim.typing import Array

SCALES = (0.03, 0.1, 0.3, 0.6, 1.0)
"""Changes of the logarithm of a joint's efforts at which simulations are compared."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations (n,) of a scene's `unknown` parameters, and (k,) of each effect's strengths by its key."""

    unknown: Array
    strengths: Mapping[Key, Array]

    def of(self, model: Model) -> Array:
        """(n + k,) those of a model's numbers."""
        return np.concatenate([self.unknown, *(self.strengths[effect.key] for effect in model.effects)])


def uncertainty(problem: OutputErrorProblem, found: SimulationFit) -> Uncertainty:
    """The standard deviations of all numbers of a fit.

    The sum of three variances: of the fit's curvature or of blocks of the recordings (`NormalEquations.covariance`), of
    the scale of all efforts at the joint (`_scale_stds`), to which the others adapt, and of what the priors of the
    scene's other unknowns, as masses, let each number vary by. None of an unknown is wider than its prior's.
    """
    numbers = problem.numbers(found.model)
    scales, moved = _scale_stds(problem, found), _moved_by_others(problem, found)
    vector, prior = found.model.vector, problem.scene.priors.std
    std = np.concatenate([prior, np.zeros(len(vector) - len(prior))])
    for j, (own, system) in enumerate(zip(numbers, found.equations, strict=True)):
        at = np.array(list(own.values()), dtype=np.int64)
        scaled = np.isin(at, _scaled(problem, found.model, j))
        along = np.where(scaled, vector[at], 0.0)
        along[~scaled] = -np.linalg.lstsq(system.J[:, ~scaled], system.J @ along, rcond=None)[0]
        std[at] = np.sqrt(system.std**2 + (scales[j] * along) ** 2 + moved[j])
    n, start, strengths = len(prior), len(prior), dict[Key, Array]()
    for effect in found.model.effects:
        strengths[effect.key] = std[start : start + len(effect.strengths)]
        start += len(effect.strengths)
    return Uncertainty(np.minimum(std[:n], prior), strengths)


def _scaled(problem: OutputErrorProblem, model: Model, joint: int) -> list[int]:
    """The indices in a model's vector of a joint's numbers that are an effort over something, or an inertia."""
    own, name = problem.numbers(model)[joint], problem.joints[joint]
    found = [i for key, i in own.items() if key.startswith(".servo_")]
    for effect in model.effects:
        if at_joint(effect.at, name):
            units = [(s, effect.unit(s, problem.scene.tree)) for s in effect.strengths if s.amplitude]
            found += [own[number_name(effect, s.name)] for s, unit in units if unit.startswith(("N", "kg"))]
    return found


def _scale_stds(problem: OutputErrorProblem, found: SimulationFit) -> Array:
    """(c,) relative standard deviations of the scale of all efforts of each joint's servo, friction and rotor.

    Where neither inertia nor gravity fixes it, simulations hardly depend on it, and slopes by differences, rough as
    simulations with friction are, seem to know it all the same. It is the change of ln scale by which −2 ln p rises by
    one, all other numbers adapted to first order: the widest of those that changes of several sizes imply, since what
    is rough rises too much over small ones.
    """
    vector, priors, n = found.model.vector, problem.scene.priors, len(problem.scene.unknown)
    numbers = [list(own.values()) for own in problem.numbers(found.model)]
    scaled = [_scaled(problem, found.model, j) for j in range(len(numbers))]

    def costs(scale: float) -> Array:
        beside = vector.copy()
        for own in scaled:
            beside[own] *= scale
        left = problem.errors_of(found.model.at(beside)) if scale != 1.0 else found.errors.copy()
        prior = np.zeros(len(numbers))
        for j, (own, moved) in enumerate(zip(numbers, scaled, strict=True)):
            others = found.equations[j].J[:, [i != moved[0] for i in own]]
            left[:, j] -= others @ np.linalg.lstsq(others, left[:, j], rcond=None)[0]
            at = [i for i in moved if i < n]
            prior[j] = np.sum(((beside[at] - priors.mean[at]) / priors.std[at]) ** 2)
        return np.asarray(problem.errors.windows * np.log(problem.errors.mean_squares(left)) + prior, dtype=float)

    here, widest = costs(1.0), np.zeros(len(numbers))
    for change in (sign * size for size in SCALES for sign in (-1.0, 1.0)):
        # a rise by Δ at a change c is a standard deviation of c/√Δ; without a rise, of c at least
        rise = np.maximum(costs(float(np.exp(change))) - here, 1.0)
        widest = np.maximum(widest, abs(change) / np.sqrt(rise))
    return np.asarray(widest, dtype=float)


def _moved_by_others(problem: OutputErrorProblem, found: SimulationFit) -> list[Array]:
    """For each joint (m,), the variances of its numbers by the unknowns of the scene that are no joint's numbers."""
    own = {i for numbers in problem.numbers(found.model) for i in numbers.values()}
    variances = [np.zeros(len(names)) for names in found.names]
    for i, std in enumerate(problem.scene.priors.std):
        if i in own:
            continue
        beside = found.model.vector.copy()
        beside[i] += std
        change = problem.errors_of(found.model.at(beside)) - found.errors
        for j, system in enumerate(found.equations):
            variances[j] += np.linalg.solve(system.information, system.weight * system.J.T @ change[:, j]) ** 2
    return variances
